//! The lights of a session: those of its scene, as edited by people.

use surfelcast_protocol::settings::{Light, LightKind, LightPatch, LightState};

use crate::error::ReviewError;
use crate::number::{MAX_INTENSITY, MAX_STRENGTH, direction, position, within};
use crate::text::clean_name;

/// Punctual lights with their ids, and the strengths of environment and emission.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSet {
    lights: Vec<RangedLight>,
    environment_strength: f32,
    emissive_strength: f32,
    has_environment: bool,
    next_id: u32,
}

/// A light as people edit it, and its range.
#[derive(Clone, Debug, PartialEq)]
pub struct RangedLight {
    /// The light.
    pub light: Light,
    /// Distance beyond which it has no effect, metres; set by the scene's file only, infinite for added lights.
    pub range: f32,
}

impl LightSet {
    /// The lights of a scene, in its order; ids are given from 1. Both strengths are 1.
    pub fn new(lights: impl IntoIterator<Item = RangedLight>, has_environment: bool) -> Self {
        let numbered = (1..).zip(lights).map(|(id, ranged)| {
            let name = clean_name(&ranged.light.name);
            RangedLight { light: Light { id, name, ..ranged.light }, range: ranged.range }
        });
        let lights: Vec<_> = numbered.collect();
        Self {
            next_id: lights.len() as u32 + 1,
            lights,
            environment_strength: 1.0,
            emissive_strength: 1.0,
            has_environment,
        }
    }

    /// Applies a change, all of it or nothing.
    pub fn apply(&mut self, patch: &LightPatch, max_lights: u32) -> Result<(), ReviewError> {
        let mut next = self.clone();
        if let Some(light) = &patch.add {
            if next.lights.len() >= max_lights as usize {
                return Err(ReviewError::TooManyLights { limit: max_lights });
            }
            let id = next.next_id;
            next.next_id = id.checked_add(1).ok_or(ReviewError::NoLightIds)?;
            let light = Light { id, ..checked("patch.add", light)? };
            next.lights.push(RangedLight { light, range: f32::INFINITY });
        }
        if let Some(light) = &patch.set {
            let at = next.index_of("patch.set.id", light.id)?;
            next.lights[at].light = checked("patch.set", light)?;
        }
        if let Some(id) = patch.remove {
            let at = next.index_of("patch.remove", id)?;
            next.lights.remove(at);
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

    /// The lights as clients see them, those that are off included.
    pub fn state(&self) -> LightState {
        LightState {
            lights: self.lights.iter().map(|ranged| ranged.light.clone()).collect(),
            environment_strength: self.environment_strength,
            emissive_strength: self.emissive_strength,
            has_environment: self.has_environment,
        }
    }

    /// The lights that are on.
    pub fn enabled(&self) -> impl Iterator<Item = &RangedLight> {
        self.lights.iter().filter(|ranged| ranged.light.enabled)
    }

    /// Factor on the environment's radiance.
    pub fn environment_strength(&self) -> f32 {
        self.environment_strength
    }

    /// Factor on all emissive surfaces.
    pub fn emissive_strength(&self) -> f32 {
        self.emissive_strength
    }

    fn index_of(&self, field: &'static str, id: u32) -> Result<usize, ReviewError> {
        let found = self.lights.iter().position(|ranged| ranged.light.id == id);
        found.ok_or(ReviewError::UnknownLight { field, id })
    }
}

/// The light with its name cleaned, if every number of it is allowed.
fn checked(field: &str, light: &Light) -> Result<Light, ReviewError> {
    position(&format!("{field}.position"), light.position)?;
    let direction_field = format!("{field}.direction");
    if light.kind == LightKind::Point {
        // Point lights do not use it, so only its numbers are checked.
        position(&direction_field, light.direction)?;
    } else {
        direction(&direction_field, light.direction)?;
    }
    for channel in light.color {
        within(&format!("{field}.color"), channel, 0.0, 1.0)?;
    }
    within(&format!("{field}.intensity"), light.intensity, 0.0, MAX_INTENSITY)?;
    if let Some([inner, outer]) = light.cone_deg {
        let cone_field = format!("{field}.cone_deg");
        within(&cone_field, outer, 0.0, 90.0)?;
        within(&cone_field, inner, 0.0, 90.0)?;
        if inner >= outer {
            return Err(ReviewError::invalid(cone_field, "the inner angle must be smaller than the outer one"));
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

    fn add(light: Light) -> LightPatch {
        LightPatch { add: Some(light), ..LightPatch::default() }
    }

    #[test]
    fn ids_are_given_once() {
        let of_scene = RangedLight { light: Light { id: 77, ..lamp() }, range: 5.0 };
        let mut set = LightSet::new([of_scene.clone(), of_scene], false);
        set.apply(&add(lamp()), 4).expect("valid");
        assert_eq!(set.state().lights.iter().map(|l| l.id).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(set.enabled().map(|l| l.range).collect::<Vec<_>>(), [5.0, 5.0, f32::INFINITY]);
        set.apply(&LightPatch { remove: Some(3), ..LightPatch::default() }, 4).expect("present");
        set.apply(&add(lamp()), 4).expect("valid");
        assert_eq!(set.state().lights.last().map(|l| l.id), Some(4), "ids are not used again");
        let off = LightPatch { set: Some(Light { id: 1, enabled: false, ..lamp() }), ..LightPatch::default() };
        set.apply(&off, 4).expect("valid");
        assert_eq!((set.enabled().count(), set.state().lights.len()), (2, 3), "lights that are off stay listed");
    }

    #[test]
    fn refused_edits_change_nothing() {
        type Edit = fn(&mut Light);
        let mut set = LightSet::new([], false);
        set.apply(&add(lamp()), 1).expect("valid");
        let full = set.apply(&add(lamp()), 1).expect_err("full").to_string();
        assert_eq!(full, "patch.add: the session has 1 lights already; remove one first");
        let bad: [(Edit, &str); 6] = [
            (|l| l.position[0] = f64::NAN, "patch.set.position: "),
            (|l| l.direction = [0.0; 3], "patch.set.direction: "),
            (|l| l.color[1] = f32::INFINITY, "patch.set.color: "),
            (|l| l.intensity = -1.0, "patch.set.intensity: "),
            (|l| l.cone_deg = Some([30.0, 20.0]), "patch.set.cone_deg: "),
            (|l| l.id = 9, "patch.set.id: "),
        ];
        let before = set.clone();
        for (edit, field) in bad {
            let mut light = Light { id: 1, ..lamp() };
            edit(&mut light);
            let patch = LightPatch { set: Some(light), emissive_strength: Some(3.0), ..LightPatch::default() };
            let error = set.apply(&patch, 4).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
            assert_eq!(set, before);
        }
        let strong = LightPatch { environment_strength: Some(f32::NAN), ..add(lamp()) };
        assert!(set.apply(&strong, 4).is_err() && set == before, "the added light is removed again");
    }
}
