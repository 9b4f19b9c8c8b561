//! Cameras of the file placed by the node tree, and the camera of files that have none.

use glam::{DVec3, Vec3};

use super::Nodes;
use crate::asset::SceneAsset;
use crate::asset::check::within;
use crate::asset::document::{CameraItem, item};
use crate::{Bounds, Camera, NamedCamera, SceneError};

/// Perspective cameras of the file by node, with unique names.
pub(crate) fn cameras(
    asset: &SceneAsset<'_>,
    nodes: &Nodes,
    center: DVec3,
    warnings: &mut Vec<String>,
) -> Result<Vec<NamedCamera>, SceneError> {
    let document = &asset.document;
    let mut cameras: Vec<NamedCamera> = Vec::new();
    for placed in &nodes.placed {
        let node = &document.nodes[placed.node];
        let Some(index) = node.camera else { continue };
        let asked_by = format!("nodes[{}].camera", placed.node);
        let item: &CameraItem = item(&document.cameras, index, "cameras", &asked_by)?;
        let Some(perspective) = &item.perspective else {
            warnings.push(format!("cameras[{index}]: orthographic cameras are left out"));
            continue;
        };
        let position = placed.world.w_axis.truncate();
        let forward = -placed.world.z_axis.truncate();
        let forward = forward.normalize_or(DVec3::NEG_Z);
        // orbiting starts about what the camera looks at, so the target is put at the scene's distance
        let distance = (center - position).dot(forward);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let camera = Camera {
            position,
            target: position + forward * distance,
            up: placed.world.y_axis.truncate(),
            vfov: perspective.yfov,
        };
        if !camera.is_valid() {
            warnings.push(format!("cameras[{index}]: spans no frame and is left out"));
            continue;
        }
        let base = node.name.as_ref().or(item.name.as_ref()).cloned().unwrap_or_else(|| format!("camera {index}"));
        let is_taken = |name: &str, list: &[NamedCamera]| list.iter().any(|camera| camera.name == name);
        let mut name = base.clone();
        let mut copy = cameras.len() + 1;
        while is_taken(&name, &cameras) {
            name = format!("{base} {copy}");
            copy += 1;
        }
        cameras.push(NamedCamera { name, camera, resolution: None });
        within("cameras", cameras.len() as u64, 1024)?;
    }
    Ok(cameras)
}

/// A view of the whole scene from the front, above and to the right.
pub(crate) fn framing(bounds: &Bounds, origin: DVec3) -> NamedCamera {
    let vfov = 40f64.to_radians();
    let center = origin + bounds.center().as_dvec3();
    let radius = f64::from(bounds.radius()).max(f64::from(f32::MIN_POSITIVE));
    let direction = Vec3::new(0.5, 0.35, 1.0).as_dvec3().normalize_or(DVec3::Z);
    let camera =
        Camera { position: center + direction * (radius / (vfov * 0.5).sin()), target: center, up: DVec3::Y, vfov };
    NamedCamera { name: "default".to_owned(), camera, resolution: None }
}
