//! A session's lights between the scene's space and units and those in which people edit them.

use glam::DVec3;
use surfelcast_protocol::settings::{Light, LightKind};
use surfelcast_renderer::scene::{Environment, LightState, PunctualKind, PunctualLight, Scene};
use surfelcast_review::LightSet;
use surfelcast_review::lights::RangedLight;

/// Cone of a spot light that names none, degrees.
const DEFAULT_CONE_DEG: [f32; 2] = [0.0, 45.0];

/// The scene's own lights, in its order.
pub(crate) fn light_set_of(scene: &Scene) -> LightSet {
    let lights = scene.punctual_lights.iter().map(|light| ranged_light_of(light, scene.origin));
    LightSet::new(lights, !matches!(scene.environment, Environment::None))
}

/// The lights that are on, as the renderer takes them. `origin` is that of the scene's space.
pub(crate) fn light_state_of(lights: &LightSet, origin: DVec3) -> LightState {
    LightState {
        punctual: lights.enabled().map(|light| punctual_of(light, origin)).collect(),
        environment_strength: lights.environment_strength(),
        emissive_strength: lights.emissive_strength(),
    }
}

fn punctual_of(RangedLight { light, range }: &RangedLight, origin: DVec3) -> PunctualLight {
    let [inner, outer] = light.cone_deg.unwrap_or(DEFAULT_CONE_DEG).map(f32::to_radians);
    let kind = match light.kind {
        LightKind::Point => PunctualKind::Point,
        LightKind::Spot => PunctualKind::Spot { inner_angle: inner, outer_angle: outer },
        LightKind::Directional => PunctualKind::Directional,
    };
    PunctualLight {
        name: light.name.clone(),
        kind,
        position: (DVec3::from_array(light.position) - origin).as_vec3(),
        direction: DVec3::from_array(light.direction).normalize_or(DVec3::NEG_Y).as_vec3(),
        intensity: light.color.map(|c| c * light.intensity),
        range: *range,
    }
}

fn ranged_light_of(light: &PunctualLight, origin: DVec3) -> RangedLight {
    let peak = light.intensity.iter().copied().fold(0.0, f32::max);
    let (kind, cone_deg) = match light.kind {
        PunctualKind::Point => (LightKind::Point, None),
        PunctualKind::Spot { inner_angle, outer_angle } => {
            (LightKind::Spot, Some([inner_angle.to_degrees(), outer_angle.to_degrees()]))
        }
        PunctualKind::Directional => (LightKind::Directional, None),
    };
    let editable = Light {
        // The set gives the id.
        id: 0,
        name: light.name.clone(),
        kind,
        position: (light.position.as_dvec3() + origin).to_array(),
        direction: light.direction.as_dvec3().to_array(),
        color: if peak > 0.0 { light.intensity.map(|c| c / peak) } else { [1.0; 3] },
        intensity: peak,
        cone_deg,
        enabled: true,
    };
    RangedLight { light: editable, range: light.range }
}

#[cfg(test)]
mod tests {
    use surfelcast_protocol::settings::LightPatch;

    use super::*;

    #[test]
    fn edits_reach_the_renderer_in_scene_space() {
        let origin = DVec3::new(100.0, 0.0, 0.0);
        let lamp = Light {
            id: 0,
            name: "Lamp".into(),
            kind: LightKind::Spot,
            position: [100.0, 2.0, 0.0],
            direction: [0.0, -2.0, 0.0],
            color: [1.0, 0.5, 0.25],
            intensity: 10.0,
            cone_deg: Some([10.0, 20.0]),
            enabled: true,
        };
        let mut set = LightSet::new([], false);
        set.apply(&LightPatch { add: Some(lamp.clone()), ..LightPatch::default() }, 4).expect("valid");
        let lights = light_state_of(&set, origin);
        assert_eq!(lights.punctual.len(), 1);
        let light = &lights.punctual[0];
        assert_eq!(light.position.to_array(), [0.0, 2.0, 0.0]);
        assert_eq!(light.direction.to_array(), [0.0, -1.0, 0.0]);
        assert_eq!(light.intensity, [10.0, 5.0, 2.5]);
        let off = LightPatch { set: Some(Light { id: 1, enabled: false, ..lamp }), ..LightPatch::default() };
        set.apply(&off, 4).expect("valid");
        assert!(light_state_of(&set, origin).punctual.is_empty());
    }

    #[test]
    fn a_scene_light_survives_the_round_trip() {
        let origin = DVec3::new(0.0, 5.0, 0.0);
        let original = PunctualLight {
            name: "sun".into(),
            kind: PunctualKind::Directional,
            position: glam::Vec3::ZERO,
            direction: glam::Vec3::NEG_Y,
            intensity: [4.0, 2.0, 1.0],
            range: f32::INFINITY,
        };
        let set = LightSet::new([ranged_light_of(&original, origin)], false);
        assert_eq!(light_state_of(&set, origin).punctual, [original]);
    }
}
