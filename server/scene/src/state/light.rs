//! Lights as a session may change them, and the file's punctual lights placed by the node tree.

use glam::{DMat4, DVec3};

use super::Nodes;
use crate::asset::SceneAsset;
use crate::asset::check::{clip, finite, invalid, within};
use crate::asset::document::{LightItem, item};
use crate::{PunctualKind, PunctualLight, Scene, SceneError};

/// What a session may change about light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightState {
    /// Punctual lights, scene space.
    pub punctual: Vec<PunctualLight>,
    /// Factor on the environment.
    pub environment_strength: f32,
    /// Factor on emissive surfaces.
    pub emissive_strength: f32,
}

impl LightState {
    /// The scene's own lights.
    pub fn of_scene(scene: &Scene) -> Self {
        Self { punctual: scene.punctual_lights.clone(), environment_strength: 1.0, emissive_strength: 1.0 }
    }
}

/// Lights of KHR_lights_punctual in scene space. Lights shine along the node's -Z; its scale does not matter.
pub(crate) fn punctual(asset: &SceneAsset<'_>, nodes: &Nodes, origin: DVec3) -> Result<Vec<PunctualLight>, SceneError> {
    let described = &asset.document.extensions.lights_punctual.lights;
    let mut lights = Vec::new();
    for placed in &nodes.placed {
        let node = &asset.document.nodes[placed.node];
        let Some(light) = node.extensions.lights_punctual.as_ref().map(|light| light.light) else { continue };
        let asked_by = format!("nodes[{}].extensions.KHR_lights_punctual.light", placed.node);
        let item = item(described, light, "lights", &asked_by)?;
        let name = item.name.as_ref().or(node.name.as_ref()).cloned().unwrap_or_else(|| format!("light {light}"));
        lights.push(convert(item, light, name, &placed.world, origin)?);
        within("punctual lights", lights.len() as u64, u64::from(asset.limits.max_punctual_lights))?;
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
