//! The view JSON beside a scene: cameras, environment, exposure, instant of an animation.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use glam::DVec3;
use serde::Deserialize;

use super::check::{clip, invalid};
use crate::{AnimationRef, Camera, Environment, Instant, NamedCamera, SceneError};

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
    /// Instant at which an animated scene is shown; member `pose` of the JSON.
    pub instant: Option<Instant>,
}

impl ViewFile {
    /// Exposure of a camera: its own, else the general one, else 1.
    pub fn exposure_for(&self, camera_name: &str) -> f32 {
        self.camera_exposure.get(camera_name).copied().or(self.exposure).unwrap_or(1.0)
    }
}

/// Longest view file that is read.
const MAX_VIEW_BYTES: u64 = 4 << 20;

/// Members by which a JSON file is recognised as a view file.
const MEMBERS: [&str; 5] = ["cameras", "environment", "exposure", "camera_exposure", "pose"];

#[allow(clippy::option_option, reason = "absent, null and given are three different things")]
#[derive(Default, Deserialize)]
#[serde(default)]
struct ViewJson {
    cameras: Vec<CameraJson>,
    #[serde(deserialize_with = "present")]
    environment: Option<Option<EnvironmentJson>>,
    exposure: Option<f64>,
    camera_exposure: BTreeMap<String, f64>,
    #[serde(rename = "pose")]
    instant: Option<InstantJson>,
}

/// Tells `null` (no environment) from an absent member (nothing said).
#[allow(clippy::option_option, reason = "absent, null and given are three different things")]
fn present<'de, D: serde::Deserializer<'de>>(d: D) -> Result<Option<Option<EnvironmentJson>>, D::Error> {
    Option::<EnvironmentJson>::deserialize(d).map(Some)
}

#[derive(Deserialize)]
struct CameraJson {
    name: String,
    position: [f64; 3],
    target: [f64; 3],
    #[serde(default = "y_up")]
    up: [f64; 3],
    vfov_deg: f64,
    resolution: Option<[u32; 2]>,
}

fn y_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum EnvironmentJson {
    Constant { radiance: [f64; 3] },
}

#[derive(Deserialize)]
struct InstantJson {
    animation: AnimationJson,
    time: f64,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum AnimationJson {
    Index(usize),
    Name(String),
}

impl ViewFile {
    /// Parses a view file. Fails on malformed JSON, cameras that span no frame, repeated names, negative radiance or
    /// exposure, and times before the start.
    pub fn parse(json: &[u8]) -> Result<Self, SceneError> {
        super::check::within("view file bytes", json.len() as u64, MAX_VIEW_BYTES)?;
        let mut deserializer = serde_json::Deserializer::from_slice(json);
        let parsed: ViewJson = serde_path_to_error::deserialize(&mut deserializer)
            .map_err(|error| invalid(clip(&format!("view.{}", error.path())), clip(&error.inner().to_string())))?;
        deserializer.end().map_err(|error| invalid("view", clip(&error.to_string())))?;

        let mut cameras: Vec<NamedCamera> = Vec::new();
        for (index, camera) in parsed.cameras.into_iter().enumerate() {
            let field = format!("view.cameras[{index}]");
            if cameras.iter().any(|other| other.name == camera.name) {
                return Err(invalid(format!("{field}.name"), "is used twice"));
            }
            if camera.resolution.is_some_and(|size| size.iter().any(|&side| side == 0 || side > 1 << 16)) {
                return Err(invalid(format!("{field}.resolution"), "must be 1 to 65536 pixels a side"));
            }
            let pinhole = Camera {
                position: DVec3::from_array(camera.position),
                target: DVec3::from_array(camera.target),
                up: DVec3::from_array(camera.up),
                vfov: camera.vfov_deg.to_radians(),
            };
            if !pinhole.is_valid() {
                let problem = "spans no frame: target must differ from position, up must not be parallel to the view, \
                               vfov_deg must lie between 0 and 180";
                return Err(invalid(field, problem));
            }
            cameras.push(NamedCamera { name: camera.name, camera: pinhole, resolution: camera.resolution });
        }
        let environment = match parsed.environment {
            None => None,
            Some(None) => Some(Environment::None),
            Some(Some(EnvironmentJson::Constant { radiance })) => {
                let radiance = radiance.map(|x| x as f32);
                if radiance.iter().any(|x| !x.is_finite() || *x < 0.0) {
                    return Err(invalid("view.environment.radiance", "must be finite and not negative"));
                }
                Some(Environment::Constant(radiance))
            }
        };
        let exposure = |field: &str, value: f64| {
            let value = value as f32;
            let is_valid = value.is_finite() && value >= 0.0;
            if is_valid { Ok(value) } else { Err(invalid(field, "must be finite and not negative")) }
        };
        Ok(Self {
            cameras,
            environment,
            exposure: parsed.exposure.map(|value| exposure("view.exposure", value)).transpose()?,
            camera_exposure: parsed
                .camera_exposure
                .into_iter()
                .map(|(name, value)| Ok((name, exposure("view.camera_exposure", value)?)))
                .collect::<Result<_, SceneError>>()?,
            instant: parsed.instant.map(|instant| Instant {
                animation: match instant.animation {
                    AnimationJson::Index(index) => AnimationRef::Index(index),
                    AnimationJson::Name(name) => AnimationRef::Name(name),
                },
                time_secs: instant.time,
            }),
        })
    }

    /// Reads and parses a view file.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        Self::parse(&read_bounded(path)?)
    }

    /// Reads the file if it exists and is a view file (a JSON object with at least one known member); other files that
    /// happen to stand there are left alone.
    pub(crate) fn read_beside(path: &Path) -> Result<Option<Self>, SceneError> {
        if !path.is_file() {
            return Ok(None);
        }
        let bytes = read_bounded(path)?;
        let value: Option<serde_json::Value> = serde_json::from_slice(&bytes).ok();
        let is_view = value.as_ref().and_then(serde_json::Value::as_object).is_some_and(|object| {
            MEMBERS.iter().any(|member| object.contains_key(*member)) && !object.contains_key("asset")
        });
        if is_view { Self::parse(&bytes).map(Some) } else { Ok(None) }
    }
}

fn read_bounded(path: &Path) -> Result<Vec<u8>, SceneError> {
    let read_error = |source| SceneError::Read { path: path.display().to_string(), source };
    let file = std::fs::File::open(path).map_err(read_error)?;
    let mut bytes = Vec::new();
    file.take(MAX_VIEW_BYTES + 1).read_to_end(&mut bytes).map_err(read_error)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_members_are_read() {
        let json = br#"{"cameras": [{"name": "a", "position": [0,1,2], "target": [0,0,0], "vfov_deg": 90,
            "resolution": [320, 180]}], "environment": {"type": "constant", "radiance": [1, 2, 3]},
            "exposure": 0.5, "camera_exposure": {"a": 2}, "pose": {"animation": "walk", "time": 0.25}, "notes": "x"}"#;
        let view = ViewFile::parse(json).unwrap();
        assert_eq!(view.cameras[0].camera.up, DVec3::Y);
        assert!((view.cameras[0].camera.vfov - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(view.environment, Some(Environment::Constant([1.0, 2.0, 3.0])));
        assert_eq!((view.exposure_for("a"), view.exposure_for("b")), (2.0, 0.5));
        assert_eq!(view.instant.unwrap().animation, AnimationRef::Name("walk".to_owned()));
    }

    #[test]
    fn no_environment_differs_from_nothing_said() {
        assert_eq!(ViewFile::parse(br#"{"environment": null}"#).unwrap().environment, Some(Environment::None));
        assert_eq!(ViewFile::parse(b"{}").unwrap().environment, None);
    }

    #[test]
    fn errors_name_the_member() {
        let message = |json: &str| ViewFile::parse(json.as_bytes()).unwrap_err().to_string();
        let camera = r#"{"name": "a", "position": [0,0,0], "target": [0,0,0], "vfov_deg": 40}"#;
        assert!(message(&format!(r#"{{"cameras": [{camera}]}}"#)).contains("view.cameras[0]"));
        assert!(message(r#"{"exposure": -1}"#).contains("view.exposure"));
        assert!(message(r#"{"environment": {"type": "constant", "radiance": [1, -2, 3]}}"#).contains("radiance"));
        assert!(message(r#"{"cameras": 3}"#).contains("view.cameras"));
    }
}
