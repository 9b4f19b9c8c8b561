//! Numbers from strangers, checked at the edge: finite, in range, and spanning a frame.

use glam::DVec3;
use surfelcast_scene::Camera;

use crate::fault::Fault;

/// Coordinates beyond this, metres, have no use and overflow squares in single precision.
const MAX_COORDINATE: f64 = 1e12;
/// Smallest and largest vertical field of view, degrees.
const VFOV_DEG: (f64, f64) = (0.1, 179.0);

/// A world-space position.
fn position(field: &str, value: [f64; 3]) -> Result<DVec3, Fault> {
    if value.iter().all(|c| c.is_finite() && c.abs() <= MAX_COORDINATE) {
        Ok(DVec3::from_array(value))
    } else {
        Err(Fault::value(field, "each coordinate must be a number within +-1e12 metres"))
    }
}

/// A direction of any useful length.
fn direction(field: &str, value: [f64; 3]) -> Result<DVec3, Fault> {
    let vector = position(field, value)?;
    let length = vector.length();
    if length > 1e-12 { Ok(vector / length) } else { Err(Fault::value(field, "must not have length 0")) }
}

/// A camera from its parts: position, target, up, and the vertical field of view in degrees. Fields are named as the
/// caller's protocol has them: `prefix.position_name`, `prefix.target` and so on.
pub fn camera(prefix: &str, position_name: &str, parts: [[f64; 3]; 3], vfov_deg: f64) -> Result<Camera, Fault> {
    let eye = position(&format!("{prefix}.{position_name}"), parts[0])?;
    let target = position(&format!("{prefix}.target"), parts[1])?;
    let up = direction(&format!("{prefix}.up"), parts[2])?;
    if !(VFOV_DEG.0..=VFOV_DEG.1).contains(&vfov_deg) {
        let reason = format!("must be within {} to {} degrees", VFOV_DEG.0, VFOV_DEG.1);
        return Err(Fault::value(format!("{prefix}.vfov_deg"), reason));
    }
    let camera = Camera { position: eye, target, up, vfov: vfov_deg.to_radians() };
    if camera.is_valid() {
        Ok(camera)
    } else {
        let reason =
            format!("{position_name} and target must differ and up must not be parallel to the view direction");
        Err(Fault::value(prefix, reason))
    }
}

/// A number within a range (NaN is in none).
pub(crate) fn within(field: &str, value: f64, low: f64, high: f64) -> Result<f64, Fault> {
    let is_within = value >= low && value <= high;
    if is_within { Ok(value) } else { Err(Fault::value(field, format!("must be within {low} to {high}"))) }
}
