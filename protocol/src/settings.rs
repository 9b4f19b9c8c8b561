//! Values that both directions share: cameras, lights, codecs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Absolute camera pose in world space. Metres; right-handed, +Y usually up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Eye.
    pub eye: [f64; 3],
    /// Point that the camera looks at.
    pub target: [f64; 3],
    /// Up direction, any length.
    pub up: [f64; 3],
    /// Vertical field of view, degrees, in (0, 180).
    pub vfov_deg: f64,
}

/// Place of an input in its gesture. `start` and `end` are always sent; a newer `move` may replace a `move`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// First input of a gesture.
    Start,
    /// Continuation.
    Move,
    /// Last input of a gesture, or an input that is a whole gesture.
    End,
}

/// Image codec; the number is the header's `codec` byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Codec {
    /// JPEG.
    Jpeg = 1,
    /// WebP, lossy or lossless.
    Webp = 2,
    /// PNG.
    Png = 4,
}

/// Kind of a punctual light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum LightKind {
    /// Point light, W/sr.
    Point,
    /// Spot light, W/sr.
    Spot,
    /// Directional light, W/m^2.
    Directional,
}

/// A punctual light of the session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Light {
    /// Stable id within the session.
    pub id: u32,
    /// Name shown to people.
    pub name: String,
    /// Kind.
    pub kind: LightKind,
    /// World position, metres (unused by directional lights).
    pub position: [f64; 3],
    /// Direction in which it shines, world space, any length (unused by point lights).
    pub direction: [f64; 3],
    /// Linear colour, each in [0, 1].
    pub color: [f32; 3],
    /// W/sr (point, spot) or W/m^2 (directional).
    pub intensity: f32,
    /// Spot cone half angles `[inner, outer]`, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cone_deg: Option<[f32; 2]>,
    /// Whether it shines; a light that is off stays listed.
    #[serde(default = "yes")]
    pub enabled: bool,
}

fn yes() -> bool {
    true
}

/// An edit of the session's lights; an absent field changes nothing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LightPatch {
    /// Add this light; the server assigns its `id`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub add: Option<Light>,
    /// Replace the light of the same id.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set: Option<Light>,
    /// Remove the light of this id.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remove: Option<u32>,
    /// Factor on the environment's radiance, in [0, 1e6].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment_strength: Option<f32>,
    /// Factor on all emissive surfaces, in [0, 1e6].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissive_strength: Option<f32>,
}

/// All lights of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LightState {
    /// Punctual lights, the scene's own first.
    pub lights: Vec<Light>,
    /// Factor on the environment.
    pub environment_strength: f32,
    /// Factor on emissive surfaces.
    pub emissive_strength: f32,
    /// Whether the scene has an environment.
    pub has_environment: bool,
}

/// A named camera of the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NamedPose {
    /// Name.
    pub name: String,
    /// Pose.
    pub pose: Pose,
    /// Exposure that its author intended, linear factor.
    pub exposure: f32,
}
