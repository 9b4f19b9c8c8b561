//! Lights of a session: the scene's own, as edited by people.

use surfelcast_scene::{PunctualLight, Scene};

/// Everything about light that a session may change. A new value replaces the old one whole.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionLights {
    /// Punctual lights in use (disabled ones left out), scene space.
    pub punctual: Vec<PunctualLight>,
    /// Factor on the environment's radiance, finite, not negative.
    pub environment_strength: f32,
    /// Factor on all emissive surfaces, finite, not negative.
    pub emissive_strength: f32,
}

impl SessionLights {
    /// The scene's own lights, unedited.
    pub fn of_scene(scene: &Scene) -> Self {
        Self { punctual: scene.punctual_lights.clone(), environment_strength: 1.0, emissive_strength: 1.0 }
    }
}
