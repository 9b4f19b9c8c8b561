//! A render as it is requested over HTTP, on the command line and by the page, and how it is read.

use std::collections::BTreeMap;

use serde::de::{Error as _, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use crate::fault::Fault;

/// A request for one image. Whatever is left out has a default, which [`RenderRequest::resolve`] fills in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RenderRequest {
    /// Scene id.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = String, required = true))]
    pub scene: Option<String>,
    /// `{"position":[x,y,z],"target":[x,y,z],"up":[x,y,z],"vfov_deg":n}`; metres, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub camera: Option<CameraRequest>,
    /// A camera of the scene, instead of `camera`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_name: Option<String>,
    /// Width, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u32>))]
    pub width: Option<Whole>,
    /// Height, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u32>))]
    pub height: Option<Whole>,
    /// Technique id.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub technique: Option<String>,
    /// Values of the technique's settings to start from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Values of the technique's settings, over the preset.
    #[serde(alias = "surfel", skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<Object>))]
    pub settings: Option<BTreeMap<String, Value>>,
    /// The setting `reconstruction`, of techniques that have it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reconstruction: Option<String>,
    /// Stop at this number of samples a pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u32>))]
    pub samples_per_pixel: Option<Whole>,
    /// Stop after this number of frames; another name of `samples_per_pixel`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u32>))]
    pub frames: Option<Whole>,
    /// Stop at this tone-mapped RMSE by the error audit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_error: Option<f64>,
    /// Stop after this time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit_secs: Option<f64>,
    /// Same seed, same image.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<u64>))]
    pub seed: Option<Whole>,
    /// `pbr` or `lambert`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub materials: Option<String>,
    /// Linear factor.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[cfg_attr(feature = "openapi", schema(value_type = Option<f32>))]
    pub exposure: Option<f64>,
    /// Extra output instead of radiance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aov: Option<String>,
}

/// A camera of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraRequest {
    /// World space, metres.
    #[serde(deserialize_with = "three_numbers")]
    pub position: Option<[f64; 3]>,
    /// Point looked at.
    #[serde(deserialize_with = "three_numbers")]
    pub target: Option<[f64; 3]>,
    /// Up direction, any length; +Y by default.
    #[serde(deserialize_with = "three_numbers", skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    pub vfov_deg: Option<f64>,
}

/// A whole number of any sign, so that what is out of range is told from what is no number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Whole(pub i128);

impl<T: Into<i128>> From<T> for Whole {
    fn from(number: T) -> Self {
        Self(number.into())
    }
}

impl Serialize for Whole {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (u64::try_from(self.0), i64::try_from(self.0)) {
            (Ok(number), _) => serializer.serialize_u64(number),
            (_, Ok(number)) => serializer.serialize_i64(number),
            _ => serializer.serialize_i128(self.0),
        }
    }
}

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WholeVisitor;
        impl Visitor<'_> for WholeVisitor {
            type Value = Whole;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a whole number")
            }

            fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<Whole, E> {
                Ok(number.into())
            }

            fn visit_i64<E: serde::de::Error>(self, number: i64) -> Result<Whole, E> {
                Ok(number.into())
            }
        }
        deserializer.deserialize_any(WholeVisitor)
    }
}

fn three_numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 3]>, D::Error> {
    let value = Value::deserialize(deserializer)?;
    if value.is_null() {
        return Ok(None);
    }
    let numbers: Option<Vec<f64>> = value.as_array().and_then(|items| items.iter().map(Value::as_f64).collect());
    let array = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    array.map(Some).ok_or_else(|| D::Error::invalid_type(Unexpected::Other("another value"), &"three numbers"))
}

impl RenderRequest {
    /// Reads a JSON body. Every refusal names its field, and unknown fields are refused: the image would be another one
    /// than the caller meant.
    pub fn parse(body: &[u8]) -> Result<Self, Fault> {
        let value: Value =
            serde_json::from_slice(body).map_err(|error| Fault::malformed("body", format!("not JSON: {error}")))?;
        let Some(fields) = value.as_object() else { return Err(Fault::malformed("body", "expected a JSON object")) };
        // Derived code would take a list for a structure.
        if fields.get("camera").is_some_and(|camera| !camera.is_object() && !camera.is_null()) {
            return Err(Fault::malformed("camera", "expected an object"));
        }
        let request: Self = serde_path_to_error::deserialize(value).map_err(|error| fault_of(&error))?;
        if request.scene.is_none() {
            return Err(Fault::malformed("scene", "missing; it is the id of a scene that GET /v1/scenes lists"));
        }
        Ok(request)
    }
}

/// The fault in our words: serde names types as Rust does.
fn fault_of(error: &serde_path_to_error::Error<serde_json::Error>) -> Fault {
    let path = error.path().to_string();
    let text = error.inner().to_string();
    if let Some(rest) = text.strip_prefix("unknown field ") {
        let mut quoted = rest.split('`').skip(1).step_by(2);
        let name: String = quoted.next().unwrap_or_default().chars().take(64).collect();
        let parent = path.rsplit_once('.').map_or("", |(parent, _)| parent);
        let parent = if parent.is_empty() { String::new() } else { format!("{parent}.") };
        let known: Vec<&str> = quoted.collect();
        return Fault::malformed(format!("{parent}{name}"), format!("unknown field; known are {}", known.join(", ")));
    }
    let expected = match text.rsplit_once("expected ").map(|(_, expected)| expected) {
        Some("f64") => "a number",
        Some("a map") => "an object",
        Some(expected) => expected,
        None => return Fault::malformed(path, text),
    };
    Fault::malformed(path, format!("expected {expected}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_well_formed_is_refused_by_field() {
        for (body, fault) in [
            ("[]", "body: expected a JSON object"),
            ("{}", "scene: missing; it is the id of a scene that GET /v1/scenes lists"),
            (r#"{"scene":null}"#, "scene: missing; it is the id of a scene that GET /v1/scenes lists"),
            (r#"{"scene":4}"#, "scene: expected a string"),
            (r#"{"scene":"s","width":"9"}"#, "width: expected a whole number"),
            (r#"{"scene":"s","width":1.5}"#, "width: expected a whole number"),
            (r#"{"scene":"s","exposure":"bright"}"#, "exposure: expected a number"),
            (r#"{"scene":"s","preset":3}"#, "preset: expected a string"),
            (r#"{"scene":"s","reconstruction":1}"#, "reconstruction: expected a string"),
            (r#"{"scene":"s","settings":4}"#, "settings: expected an object"),
            (r#"{"scene":"s","camera":7}"#, "camera: expected an object"),
            (r#"{"scene":"s","camera":[]}"#, "camera: expected an object"),
            (r#"{"scene":"s","camera":{"position":[0,0]}}"#, "camera.position: expected three numbers"),
            (r#"{"scene":"s","camera":{"position":[0,0,1,"x"]}}"#, "camera.position: expected three numbers"),
            (
                r#"{"scene":"s","camera":{"fov":1}}"#,
                "camera.fov: unknown field; known are position, target, up, vfov_deg",
            ),
        ] {
            let found = RenderRequest::parse(body.as_bytes()).expect_err(body);
            assert_eq!((found.to_string().as_str(), found.is_malformed), (fault, true), "{body}");
        }
        for body in ["{", r#"{"scene":"s","max_error":1e999}"#] {
            let fault = RenderRequest::parse(body.as_bytes()).expect_err(body);
            assert!(fault.to_string().starts_with("body: not JSON: "), "{fault}");
        }
        let fault = RenderRequest::parse(br#"{"scene":"s","spp":4}"#).expect_err("unknown");
        assert!(fault.to_string().starts_with("spp: unknown field; known are scene, camera, camera_name,"), "{fault}");
    }

    #[test]
    fn requests_survive_the_round_trip() {
        let body = r#"{"scene":"s","camera":{"position":[0,0,1],"target":[0,0,0],"vfov_deg":40},"width":8,"height":6,
            "seed":18446744073709551615,"settings":{"radius":4,"depth":null},"max_error":0.5,"technique":null}"#;
        let request = RenderRequest::parse(body.as_bytes()).expect("well formed");
        assert_eq!(request.seed, Some(Whole(u64::MAX.into())));
        let json = serde_json::to_vec(&request).expect("encodes");
        assert_eq!(RenderRequest::parse(&json).expect("well formed"), request);
        // The earlier name of the settings.
        let earlier = body.replace("\"settings\"", "\"surfel\"");
        assert_eq!(RenderRequest::parse(earlier.as_bytes()).expect("well formed"), request);
    }
}
