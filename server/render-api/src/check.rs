//! Numbers from strangers, checked at the edge: finite, in range, and spanning a frame.

use glam::DVec3;
use surfelcast_scene::Camera;

/// Coordinates beyond this, metres, have no use and overflow squares in single precision.
pub const MAX_COORDINATE: f64 = 1e12;
/// Smallest and largest vertical field of view, degrees.
pub const VFOV_DEG: (f64, f64) = (0.1, 179.0);
/// Smallest and largest exposure, linear factor.
pub const EXPOSURE: (f32, f32) = (1e-6, 1e6);

/// `Err` holds the field, the limit and the remedy.
pub type Checked<T> = Result<T, String>;

/// A world-space position.
pub fn position(field: &str, value: [f64; 3]) -> Checked<DVec3> {
    if value.iter().all(|c| c.is_finite() && c.abs() <= MAX_COORDINATE) {
        Ok(DVec3::from_array(value))
    } else {
        Err(format!("{field}: each coordinate must be a number within +-1e12 metres"))
    }
}

/// A direction of any useful length.
pub fn direction(field: &str, value: [f64; 3]) -> Checked<DVec3> {
    let vector = position(field, value)?;
    let length = vector.length();
    if length > 1e-12 { Ok(vector / length) } else { Err(format!("{field}: must not have length 0")) }
}

/// A camera from its parts: position, target, up, and the vertical field of view in degrees. Fields are named as the
/// caller's protocol has them: `prefix.position_name`, `prefix.target` and so on.
pub fn camera(prefix: &str, position_name: &str, parts: [[f64; 3]; 3], vfov_deg: f64) -> Checked<Camera> {
    let eye = position(&format!("{prefix}.{position_name}"), parts[0])?;
    let target = position(&format!("{prefix}.target"), parts[1])?;
    let up = direction(&format!("{prefix}.up"), parts[2])?;
    if !(VFOV_DEG.0..=VFOV_DEG.1).contains(&vfov_deg) {
        return Err(format!("{prefix}.vfov_deg: must be within {} to {} degrees", VFOV_DEG.0, VFOV_DEG.1));
    }
    let camera = Camera { position: eye, target, up, vfov: vfov_deg.to_radians() };
    if camera.is_valid() {
        Ok(camera)
    } else {
        Err(format!(
            "{prefix}: {position_name} and target must differ and up must not be parallel to the view direction"
        ))
    }
}

/// A number within a range (NaN is in none).
pub fn within<T: PartialOrd + std::fmt::Display + Copy>(field: &str, value: T, low: T, high: T) -> Checked<T> {
    if value >= low && value <= high { Ok(value) } else { Err(format!("{field}: must be within {low} to {high}")) }
}
