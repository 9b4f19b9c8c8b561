//! Cameras between the protocol's poses and the renderer.

use surfelcast_protocol::settings::Pose;
use surfelcast_renderer::scene::Camera;
use surfelcast_review::ReviewError;
use surfelcast_review::number::{VFOV_DEG, direction, position};

/// A camera from its parts; names of the fields as the caller's protocol has them.
pub(crate) fn camera(prefix: &str, eye_name: &str, pose: &Pose) -> Result<Camera, ReviewError> {
    let eye = position(&format!("{prefix}.{eye_name}"), pose.eye)?;
    let target = position(&format!("{prefix}.target"), pose.target)?;
    let up = direction(&format!("{prefix}.up"), pose.up)?;
    let vfov = pose.vfov_deg;
    if !(VFOV_DEG.0..=VFOV_DEG.1).contains(&vfov) {
        let reason = format!("must be within {} to {} degrees", VFOV_DEG.0, VFOV_DEG.1);
        return Err(ReviewError::invalid(format!("{prefix}.vfov_deg"), reason));
    }
    let camera = Camera { position: eye, target, up, vfov: vfov.to_radians() };
    if camera.is_valid() {
        Ok(camera)
    } else {
        let reason = format!("{eye_name} and target must differ and up must not be parallel to the view direction");
        Err(ReviewError::invalid(prefix, reason))
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
            let error = camera("pose", "eye", &pose).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
        };
        refused(|p| p.eye[0] = f64::NAN, "pose.eye: ");
        refused(|p| p.eye[2] = f64::INFINITY, "pose.eye: ");
        refused(|p| p.target[1] = 1e13, "pose.target: ");
        refused(|p| p.up = [0.0; 3], "pose.up: ");
        refused(|p| p.up = [0.0, 0.0, 2.0], "pose: ");
        refused(|p| p.target = p.eye, "pose: ");
        for vfov in [0.0, -45.0, 180.0, f64::NAN] {
            let error = camera("pose", "eye", &Pose { vfov_deg: vfov, ..POSE }).expect_err("vfov").to_string();
            assert!(error.starts_with("pose.vfov_deg: "), "{error}");
        }
    }

    #[test]
    fn poses_survive_the_round_trip() {
        let once = camera("pose", "eye", &POSE).expect("valid");
        let pose = pose_of(&once);
        assert!((pose.vfov_deg - POSE.vfov_deg).abs() < 1e-12);
        assert_eq!((pose.eye, pose.target, pose.up), (POSE.eye, POSE.target, POSE.up));
    }
}
