//! Numbers from strangers, checked at the edge: finite, in range, and spanning a frame.

use glam::DVec3;
use surfelcast_protocol::limits::Limits;
use surfelcast_protocol::settings::Pose;
use surfelcast_renderer::scene::Camera;

/// Coordinates beyond this, metres, have no use and overflow squares in single precision.
pub(crate) const MAX_COORDINATE: f64 = 1e12;
/// Smallest and largest vertical field of view, degrees.
pub(crate) const VFOV_DEG: (f64, f64) = (0.1, 179.0);
/// Smallest and largest exposure, linear factor.
pub(crate) const EXPOSURE: (f32, f32) = (1e-6, 1e6);
/// Largest intensity of a light and largest strength of environment or emission.
pub(crate) const MAX_INTENSITY: f32 = 1e9;
/// Largest factor on environment and emission.
pub(crate) const MAX_STRENGTH: f32 = 1e6;

/// `Err` holds the field, the limit and the remedy.
pub(crate) type Checked<T> = Result<T, String>;

/// A world-space position.
pub(crate) fn position(field: &str, value: [f64; 3]) -> Checked<DVec3> {
    if value.iter().all(|c| c.is_finite() && c.abs() <= MAX_COORDINATE) {
        Ok(DVec3::from_array(value))
    } else {
        Err(format!("{field}: each coordinate must be a number within +-1e12 metres"))
    }
}

/// A direction of any useful length.
pub(crate) fn direction(field: &str, value: [f64; 3]) -> Checked<DVec3> {
    let vector = position(field, value)?;
    let length = vector.length();
    if length > 1e-12 { Ok(vector / length) } else { Err(format!("{field}: must not have length 0")) }
}

/// A camera from its parts; names of the fields as the caller's protocol has them.
pub(crate) fn camera(prefix: &str, eye_name: &str, pose: &Pose) -> Checked<Camera> {
    let eye = position(&format!("{prefix}.{eye_name}"), pose.eye)?;
    let target = position(&format!("{prefix}.target"), pose.target)?;
    let up = direction(&format!("{prefix}.up"), pose.up)?;
    let vfov = pose.vfov_deg;
    if !(VFOV_DEG.0..=VFOV_DEG.1).contains(&vfov) {
        return Err(format!("{prefix}.vfov_deg: must be within {} to {} degrees", VFOV_DEG.0, VFOV_DEG.1));
    }
    let camera = Camera { position: eye, target, up, vfov: vfov.to_radians() };
    if camera.is_valid() {
        Ok(camera)
    } else {
        Err(format!("{prefix}: {eye_name} and target must differ and up must not be parallel to the view direction"))
    }
}

/// The reverse of [`camera`].
pub(crate) fn pose_of(camera: &Camera) -> Pose {
    Pose {
        eye: camera.position.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        vfov_deg: camera.vfov.to_degrees(),
    }
}

/// A number within a range (NaN is in none).
pub(crate) fn within<T: PartialOrd + std::fmt::Display + Copy>(field: &str, value: T, low: T, high: T) -> Checked<T> {
    if value >= low && value <= high { Ok(value) } else { Err(format!("{field}: must be within {low} to {high}")) }
}

/// Size of an interactive view.
pub(crate) fn view_size(size: [u32; 2], limits: &Limits) -> Checked<[u32; 2]> {
    within("w", size[0], 1, limits.max_side)?;
    within("h", size[1], 1, limits.max_side)?;
    if u64::from(size[0]) * u64::from(size[1]) > u64::from(limits.max_pixels) {
        return Err(format!("w x h: more than the limit of {} pixels; ask for a smaller view", limits.max_pixels));
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: Pose = Pose { eye: [0.0, 1.0, 3.0], target: [0.0, 1.0, 0.0], up: [0.0, 1.0, 0.0], vfov_deg: 45.0 };

    #[test]
    fn extremes_are_refused_by_field() {
        assert!(camera("pose", "eye", &POSE).is_ok());
        let refused = |edit: fn(&mut Pose), field: &str| {
            let mut pose = POSE;
            edit(&mut pose);
            let error = camera("pose", "eye", &pose).expect_err(field);
            assert!(error.starts_with(field), "{error}");
        };
        refused(|p| p.eye[0] = f64::NAN, "pose.eye");
        refused(|p| p.eye[2] = f64::INFINITY, "pose.eye");
        refused(|p| p.target[1] = 1e13, "pose.target");
        refused(|p| p.up = [0.0; 3], "pose.up");
        refused(|p| p.up = [0.0, 0.0, 2.0], "pose");
        refused(|p| p.target = p.eye, "pose");
        for vfov in [0.0, -45.0, 180.0, f64::NAN] {
            let error = camera("pose", "eye", &Pose { vfov_deg: vfov, ..POSE }).expect_err("vfov");
            assert!(error.starts_with("pose.vfov_deg"), "{error}");
        }
    }

    #[test]
    fn poses_survive_the_round_trip() {
        let once = camera("pose", "eye", &POSE).expect("valid");
        let pose = pose_of(&once);
        assert!((pose.vfov_deg - POSE.vfov_deg).abs() < 1e-12);
        assert_eq!((pose.eye, pose.target, pose.up), (POSE.eye, POSE.target, POSE.up));
    }

    #[test]
    fn views_are_bounded_by_side_and_area() {
        let limits = Limits::default();
        assert!(view_size([1920, 1080], &limits).is_ok());
        for size in [[0, 10], [10, 0], [4097, 1], [4096, 4096]] {
            assert!(view_size(size, &limits).is_err(), "{size:?}");
        }
    }
}
