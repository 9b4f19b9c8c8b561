//! Cameras between the protocol's poses and the renderer.

use surfelcast_protocol::settings::Pose;
use surfelcast_render_api::check;
use surfelcast_renderer::scene::Camera;
use surfelcast_review::ReviewError;

/// The camera of a pose.
pub(crate) fn camera(prefix: &str, pose: &Pose) -> Result<Camera, ReviewError> {
    let camera = check::camera(prefix, "eye", [pose.eye, pose.target, pose.up], pose.vfov_deg);
    camera.map_err(|fault| ReviewError::invalid(fault.field, fault.reason))
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
        assert!(camera("pose", &POSE).is_ok());
        let refused = |edit: fn(&mut Pose), field: &str| {
            let mut pose = POSE;
            edit(&mut pose);
            let error = camera("pose", &pose).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
        };
        refused(|p| p.eye[0] = f64::NAN, "pose.eye: ");
        refused(|p| p.eye[2] = f64::INFINITY, "pose.eye: ");
        refused(|p| p.target[1] = 1e13, "pose.target: ");
        refused(|p| p.up = [0.0; 3], "pose.up: ");
        refused(|p| p.up = [0.0, 0.0, 2.0], "pose: ");
        refused(|p| p.target = p.eye, "pose: ");
        for vfov in [0.0, -45.0, 180.0, f64::NAN] {
            let error = camera("pose", &Pose { vfov_deg: vfov, ..POSE }).expect_err("vfov").to_string();
            assert!(error.starts_with("pose.vfov_deg: "), "{error}");
        }
    }

    #[test]
    fn poses_survive_the_round_trip() {
        let once = camera("pose", &POSE).expect("valid");
        let pose = pose_of(&once);
        assert!((pose.vfov_deg - POSE.vfov_deg).abs() < 1e-12);
        assert_eq!((pose.eye, pose.target, pose.up), (POSE.eye, POSE.target, POSE.up));
    }
}
