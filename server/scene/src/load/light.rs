//! Punctual lights and cameras, placed by the node tree.

use glam::{DMat4, DVec3, Vec3};

use super::check::{clip, finite, invalid, within};
use super::document::{CameraItem, Document, LightItem, item};
use super::hierarchy::Hierarchy;
use crate::{Bounds, Camera, NamedCamera, PunctualKind, PunctualLight, SceneError, SceneLimits};

/// Lights of KHR_lights_punctual in scene space. Lights shine along the node's -Z; its scale does not matter.
pub(crate) fn punctual(
    document: &Document,
    hierarchy: &Hierarchy,
    origin: DVec3,
    limits: &SceneLimits,
) -> Result<Vec<PunctualLight>, SceneError> {
    let described = &document.extensions.lights_punctual.lights;
    let mut lights = Vec::new();
    for placed in &hierarchy.placed {
        let node = &document.nodes[placed.node];
        let Some(light) = node.extensions.lights_punctual.as_ref().map(|light| light.light) else { continue };
        let asked_by = format!("nodes[{}].extensions.KHR_lights_punctual.light", placed.node);
        let item = item(described, light, "lights", &asked_by)?;
        let name = item.name.as_ref().or(node.name.as_ref()).cloned().unwrap_or_else(|| format!("light {light}"));
        lights.push(convert(item, light, name, &placed.world, origin)?);
        within("punctual lights", lights.len() as u64, u64::from(limits.max_punctual_lights))?;
    }
    Ok(lights)
}

fn convert(
    item: &LightItem,
    index: usize,
    name: String,
    world: &DMat4,
    origin: DVec3,
) -> Result<PunctualLight, SceneError> {
    let field = |name: &str| format!("KHR_lights_punctual.lights[{index}].{name}");
    let kind = match item.kind.as_str() {
        "point" => PunctualKind::Point,
        "directional" => PunctualKind::Directional,
        "spot" => {
            let spot = item.spot.as_ref();
            let outer = spot.and_then(|s| s.outer_cone_angle).unwrap_or(std::f64::consts::FRAC_PI_4);
            let inner = spot.and_then(|s| s.inner_cone_angle).unwrap_or(0.0);
            if !(outer > 0.0 && outer <= std::f64::consts::FRAC_PI_2 + 1e-6 && (0.0..=outer).contains(&inner)) {
                return Err(invalid(field("spot"), "cone angles must hold 0 <= inner <= outer <= pi/2 and outer > 0"));
            }
            PunctualKind::Spot { inner_angle: inner as f32, outer_angle: outer as f32 }
        }
        other => return Err(invalid(field("type"), format!("{:?} is unknown", clip(other)))),
    };
    let scale = item.intensity.unwrap_or(1.0).max(0.0);
    let mut intensity = [0.0; 3];
    for (out, color) in intensity.iter_mut().zip(item.color.unwrap_or([1.0; 3])) {
        *out = finite(color.max(0.0) * scale, &field("intensity"))?;
    }
    let range = item.range.map_or(f32::INFINITY, |range| range as f32);
    if range.is_nan() || range <= 0.0 {
        return Err(invalid(field("range"), "must be greater than 0"));
    }
    let axis = -world.z_axis.truncate();
    let direction = axis.normalize_or(DVec3::NEG_Z).as_vec3();
    let position = (world.w_axis.truncate() - origin).as_vec3();
    if !position.is_finite() {
        return Err(invalid(field("position"), "is out of range"));
    }
    Ok(PunctualLight { name, kind, position, direction, intensity, range })
}

/// Perspective cameras of the file by node, with unique names.
pub(crate) fn cameras(
    document: &Document,
    hierarchy: &Hierarchy,
    center: DVec3,
    warnings: &mut Vec<String>,
) -> Result<Vec<NamedCamera>, SceneError> {
    let mut cameras: Vec<NamedCamera> = Vec::new();
    for placed in &hierarchy.placed {
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
