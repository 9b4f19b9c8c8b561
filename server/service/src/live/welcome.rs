//! The answer to `hello`.

use std::sync::atomic::{AtomicU64, Ordering};

use surfelcast_protocol::server::{SessionInfo, TechniqueInfo, Welcome};
use surfelcast_protocol::settings::NamedPose;

use crate::camera::pose_of;
use crate::sessions::Live;
use crate::state::ServiceState;

/// Everything that a client must know before its first frame. `token` resumes its view.
pub(crate) fn welcome(state: &ServiceState, live: &Live, token: &str) -> Welcome {
    static CONNECTIONS: AtomicU64 = AtomicU64::new(1);
    let status = state.renderer_status();
    let config = state.config();
    let scene = &live.scene;
    let named = |camera: &surfelcast_renderer::scene::NamedCamera| NamedPose {
        name: camera.name.clone(),
        pose: pose_of(&camera.camera),
        exposure: scene.exposure_for(&camera.name),
    };
    let technique = |t: &surfelcast_renderer::status::TechniqueDescription| TechniqueInfo {
        id: t.id.into(),
        label: t.label.into(),
        summary: t.summary.into(),
    };
    Welcome {
        v: surfelcast_protocol::VERSION,
        conn: format!("c{}", CONNECTIONS.fetch_add(1, Ordering::Relaxed)),
        session: SessionInfo {
            id: live.id().to_string(),
            scene: live.record.id.clone(),
            scene_name: live.record.name.clone(),
            scene_rev: live.revision(),
            epoch: status.epoch,
            triangle_count: live.record.triangle_count,
        },
        limits: config.limits,
        techniques: status.techniques.iter().map(technique).collect(),
        outputs: crate::live::outputs::offered(),
        cameras: scene.cameras.iter().map(named).collect(),
        center: (scene.origin + scene.bounds.center().as_dvec3()).to_array(),
        radius: f64::from(scene.bounds.radius()),
        warnings: live.record.warnings.clone(),
        server_ms: state.server_ms(),
        resume_token: token.to_owned(),
        grace_ms: config.timeouts.resume.as_millis() as u32,
        server: config.server.clone(),
        device: status.device.name.clone(),
    }
}
