//! Edits of a scene that a session shows.

use super::LightState;

/// A change of what a session shows. Each kind carries the whole of what it replaces, so that of several edits of a
/// kind only the last counts.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneEdit {
    /// Replaces all lights.
    Lights(LightState),
}
