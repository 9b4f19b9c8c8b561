//! The view JSON beside a scene: cameras, environment, exposure, pose.

use std::collections::BTreeMap;

use crate::{Environment, NamedCamera};

/// An instant of an animation.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Index or name of the animation.
    pub animation: AnimationRef,
    /// Seconds from its start.
    pub time_secs: f64,
}

/// How a view file names an animation.
#[derive(Clone, Debug, PartialEq)]
pub enum AnimationRef {
    /// Position in the file.
    Index(usize),
    /// Name in the file.
    Name(String),
}

/// Parsed view file. All fields are optional in the JSON; unknown ones are ignored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewFile {
    /// Cameras in the file's order.
    pub cameras: Vec<NamedCamera>,
    /// Environment, where stated.
    pub environment: Option<Environment>,
    /// Exposure for every camera (linear factor).
    pub exposure: Option<f32>,
    /// Exposure by camera name.
    pub camera_exposure: BTreeMap<String, f32>,
    /// Pose of animated scenes.
    pub pose: Option<Pose>,
}

impl ViewFile {
    /// Exposure of a camera: its own, else the general one, else 1.
    pub fn exposure_for(&self, camera_name: &str) -> f32 {
        self.camera_exposure.get(camera_name).copied().or(self.exposure).unwrap_or(1.0)
    }
}
