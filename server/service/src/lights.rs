//! The lights of a session: the scene's own, as edited by its members.

use glam::DVec3;
use surfelcast_protocol::settings::{Light, LightKind, LightPatch, LightState};
use surfelcast_renderer::SessionLights;
use surfelcast_renderer::scene::{Environment, PunctualKind, PunctualLight, Scene};

use crate::text::clean_name;
use crate::validate::{Checked, MAX_INTENSITY, MAX_STRENGTH, direction, position, within};

/// Cone of a spot light that names none, degrees.
const DEFAULT_CONE_DEG: [f32; 2] = [0.0, 45.0];

/// Lights as people edit them, with what the renderer needs beside.
#[derive(Clone, Debug)]
pub(crate) struct LightSet {
    origin: DVec3,
    lights: Vec<Light>,
    /// Range of each light, metres; people do not edit it.
    ranges: Vec<f32>,
    environment_strength: f32,
    emissive_strength: f32,
    has_environment: bool,
    next_id: u32,
}

impl LightSet {
    /// The scene's own lights, ids from 1 in the scene's order, at most `limit` of them listed.
    pub(crate) fn of_scene(scene: &Scene) -> Self {
        let lights: Vec<Light> =
            (1..).zip(&scene.punctual_lights).map(|(id, l)| light_of(id, l, scene.origin)).collect();
        Self {
            origin: scene.origin,
            next_id: lights.len() as u32 + 1,
            ranges: scene.punctual_lights.iter().map(|l| l.range).collect(),
            lights,
            environment_strength: 1.0,
            emissive_strength: 1.0,
            has_environment: !matches!(scene.environment, Environment::None),
        }
    }

    /// Applies a change, all of it or nothing.
    pub(crate) fn apply(&mut self, patch: &LightPatch, max_lights: u32) -> Checked<()> {
        let mut next = self.clone();
        if let Some(light) = &patch.add {
            if next.lights.len() >= max_lights as usize {
                return Err(format!("patch.add: the session has {max_lights} lights already; remove one first"));
            }
            let id = next.next_id;
            next.next_id = id.checked_add(1).ok_or("patch.add: no light ids are left in this session")?;
            next.lights.push(Light { id, ..checked("patch.add", light)? });
            next.ranges.push(f32::INFINITY);
        }
        if let Some(light) = &patch.set {
            let at = next.index_of("patch.set.id", light.id)?;
            next.lights[at] = checked("patch.set", light)?;
        }
        if let Some(id) = patch.remove {
            let at = next.index_of("patch.remove", id)?;
            next.lights.remove(at);
            next.ranges.remove(at);
        }
        if let Some(strength) = patch.environment_strength {
            next.environment_strength = within("patch.environment_strength", strength, 0.0, MAX_STRENGTH)?;
        }
        if let Some(strength) = patch.emissive_strength {
            next.emissive_strength = within("patch.emissive_strength", strength, 0.0, MAX_STRENGTH)?;
        }
        *self = next;
        Ok(())
    }

    /// What clients are told.
    pub(crate) fn state(&self) -> LightState {
        LightState {
            lights: self.lights.clone(),
            environment_strength: self.environment_strength,
            emissive_strength: self.emissive_strength,
            has_environment: self.has_environment,
        }
    }

    /// What the renderer is told.
    pub(crate) fn session_lights(&self) -> SessionLights {
        let enabled = self.lights.iter().zip(&self.ranges).filter(|(light, _)| light.enabled);
        SessionLights {
            punctual: enabled.map(|(light, range)| self.punctual_of(light, *range)).collect(),
            environment_strength: self.environment_strength,
            emissive_strength: self.emissive_strength,
        }
    }

    fn index_of(&self, field: &str, id: u32) -> Checked<usize> {
        self.lights
            .iter()
            .position(|light| light.id == id)
            .ok_or_else(|| format!("{field}: there is no light {id} in this session"))
    }

    fn punctual_of(&self, light: &Light, range: f32) -> PunctualLight {
        let [inner, outer] = light.cone_deg.unwrap_or(DEFAULT_CONE_DEG).map(f32::to_radians);
        let kind = match light.kind {
            LightKind::Point => PunctualKind::Point,
            LightKind::Spot => PunctualKind::Spot { inner_angle: inner, outer_angle: outer },
            LightKind::Directional => PunctualKind::Directional,
        };
        PunctualLight {
            name: light.name.clone(),
            kind,
            position: (DVec3::from_array(light.position) - self.origin).as_vec3(),
            direction: DVec3::from_array(light.direction).normalize_or(DVec3::NEG_Y).as_vec3(),
            intensity: light.color.map(|c| c * light.intensity),
            range,
        }
    }
}

fn light_of(id: u32, light: &PunctualLight, origin: DVec3) -> Light {
    let peak = light.intensity.iter().copied().fold(0.0, f32::max);
    let (kind, cone_deg) = match light.kind {
        PunctualKind::Point => (LightKind::Point, None),
        PunctualKind::Spot { inner_angle, outer_angle } => {
            (LightKind::Spot, Some([inner_angle.to_degrees(), outer_angle.to_degrees()]))
        }
        PunctualKind::Directional => (LightKind::Directional, None),
    };
    Light {
        id,
        name: clean_name(&light.name),
        kind,
        position: (light.position.as_dvec3() + origin).to_array(),
        direction: light.direction.as_dvec3().to_array(),
        color: if peak > 0.0 { light.intensity.map(|c| c / peak) } else { [1.0; 3] },
        intensity: peak,
        cone_deg,
        enabled: true,
    }
}

fn checked(field: &str, light: &Light) -> Checked<Light> {
    position(&format!("{field}.position"), light.position)?;
    if light.kind == LightKind::Point {
        // Not used, but a number all the same.
        position(&format!("{field}.direction"), light.direction)?;
    } else {
        direction(&format!("{field}.direction"), light.direction)?;
    }
    for channel in light.color {
        within(&format!("{field}.color"), channel, 0.0, 1.0)?;
    }
    within(&format!("{field}.intensity"), light.intensity, 0.0, MAX_INTENSITY)?;
    if let Some([inner, outer]) = light.cone_deg {
        within(&format!("{field}.cone_deg"), outer, 0.0, 90.0)?;
        within(&format!("{field}.cone_deg"), inner, 0.0, 90.0)?;
        if inner >= outer {
            return Err(format!("{field}.cone_deg: the inner angle must be smaller than the outer one"));
        }
    }
    Ok(Light { name: clean_name(&light.name), ..light.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp() -> Light {
        Light {
            id: 0,
            name: "Lamp".into(),
            kind: LightKind::Spot,
            position: [100.0, 2.0, 0.0],
            direction: [0.0, -2.0, 0.0],
            color: [1.0, 0.5, 0.25],
            intensity: 10.0,
            cone_deg: Some([10.0, 20.0]),
            enabled: true,
        }
    }

    fn empty(origin: DVec3) -> LightSet {
        LightSet {
            origin,
            lights: Vec::new(),
            ranges: Vec::new(),
            environment_strength: 1.0,
            emissive_strength: 1.0,
            has_environment: false,
            next_id: 1,
        }
    }

    fn add(light: Light) -> LightPatch {
        LightPatch { add: Some(light), ..LightPatch::default() }
    }

    #[test]
    fn edits_reach_the_renderer_in_its_own_space() {
        let mut set = empty(DVec3::new(100.0, 0.0, 0.0));
        set.apply(&add(lamp()), 4).expect("valid");
        let lights = set.session_lights();
        assert_eq!(lights.punctual.len(), 1);
        let light = &lights.punctual[0];
        assert_eq!(light.position.to_array(), [0.0, 2.0, 0.0]);
        assert_eq!(light.direction.to_array(), [0.0, -1.0, 0.0]);
        assert_eq!(light.intensity, [10.0, 5.0, 2.5]);
        assert_eq!(set.state().lights[0].id, 1, "ids are the server's");
        let off = LightPatch { set: Some(Light { id: 1, enabled: false, ..lamp() }), ..LightPatch::default() };
        set.apply(&off, 4).expect("valid");
        assert!(set.session_lights().punctual.is_empty());
        assert_eq!(set.state().lights.len(), 1, "off lights stay listed");
        set.apply(&LightPatch { remove: Some(1), ..LightPatch::default() }, 4).expect("there");
        set.apply(&add(lamp()), 4).expect("valid");
        assert_eq!(set.state().lights[0].id, 2, "ids are not used again");
    }

    #[test]
    fn bad_lights_change_nothing() {
        type Edit = fn(&mut Light);
        let mut set = empty(DVec3::ZERO);
        set.apply(&add(lamp()), 1).expect("valid");
        let full = set.apply(&add(lamp()), 1).expect_err("full");
        assert!(full.contains("1 lights"), "{full}");
        let bad: [(Edit, &str); 6] = [
            (|l| l.position[0] = f64::NAN, "position"),
            (|l| l.direction = [0.0; 3], "direction"),
            (|l| l.color[1] = f32::INFINITY, "color"),
            (|l| l.intensity = -1.0, "intensity"),
            (|l| l.cone_deg = Some([30.0, 20.0]), "cone_deg"),
            (|l| l.id = 9, "id"),
        ];
        for (edit, field) in bad {
            let mut light = Light { id: 1, ..lamp() };
            edit(&mut light);
            let patch = LightPatch { set: Some(light), emissive_strength: Some(3.0), ..LightPatch::default() };
            let error = set.apply(&patch, 4).expect_err(field);
            assert!(error.contains(field), "{error}");
        }
        let state = set.state();
        assert_eq!((state.lights[0].intensity, state.emissive_strength), (10.0, 1.0));
    }

    #[test]
    fn a_scene_light_looks_the_same_after_listing() {
        let origin = DVec3::new(0.0, 5.0, 0.0);
        let original = PunctualLight {
            name: "sun".into(),
            kind: PunctualKind::Directional,
            position: glam::Vec3::ZERO,
            direction: glam::Vec3::NEG_Y,
            intensity: [4.0, 2.0, 1.0],
            range: f32::INFINITY,
        };
        let set =
            LightSet { lights: vec![light_of(1, &original, origin)], ranges: vec![original.range], ..empty(origin) };
        assert_eq!(set.session_lights().punctual, [original]);
    }
}
