//! Messages from the client to the server.

use schemars::JsonSchema;
use serde::de::Error as _;
use serde::de::value::{Error as ValueError, StrDeserializer};
use serde::{Deserialize, Deserializer, Serialize};

use crate::settings::{Codec, LightPatch, Phase, Pose};

/// A control message with its optional request id, which the answer repeats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClientEnvelope {
    /// Request id chosen by the client.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<u64>,
    /// The message.
    #[serde(flatten)]
    pub message: ClientMessage,
}

/// A message from the client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "t")]
pub enum ClientMessage {
    /// The first message, due within [`crate::limits::Limits::hello_timeout_ms`].
    #[serde(rename = "hello")]
    Hello(Hello),
    /// New camera of a view.
    #[serde(rename = "camera")]
    Camera(CameraInput),
    /// Edit of the session's lights.
    #[serde(rename = "light")]
    Light(LightInput),
    /// New settings of a view.
    #[serde(rename = "view.set")]
    ViewSet(ViewSet),
    /// Acknowledges a frame and all before it.
    #[serde(rename = "ack")]
    Ack(Ack),
    /// Requests a still of the present frame.
    #[serde(rename = "still")]
    Still {
        /// View.
        #[serde(default)]
        view: u16,
    },
    /// Which surface is at a point of the last acknowledged frame; answered by `picked`.
    #[serde(rename = "pick")]
    Pick {
        /// View.
        #[serde(default)]
        view: u16,
        /// Horizontal position, 0 (left) to 1.
        x: f32,
        /// Vertical position, 0 (top) to 1.
        y: f32,
    },
    /// What lights the surface at a point of the last acknowledged frame, as a technique explains it; answered by
    /// `inspected`.
    #[serde(rename = "inspect")]
    Inspect {
        /// View.
        #[serde(default)]
        view: u16,
        /// Horizontal position, 0 (left) to 1.
        x: f32,
        /// Vertical position, 0 (top) to 1.
        y: f32,
    },
    /// Application-level ping; answered by `pong` with the same `ts`.
    #[serde(rename = "ping")]
    Ping {
        /// Client's monotonic milliseconds.
        ts: f64,
    },
    /// Answer to the server's `ping`.
    #[serde(rename = "pong")]
    Pong {
        /// The server's `ts`.
        ts: f64,
    },
}

/// What a client states about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Hello {
    /// Protocol versions that the client supports.
    pub v: Vec<u32>,
    /// Program and version, for logs; at most 128 characters.
    #[serde(default)]
    pub client: String,
    /// What it can decode and show.
    pub caps: Caps,
    /// Token of an earlier connection whose view is resumed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resume: Option<String>,
}

/// Capabilities of a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Caps {
    /// Codecs that it decodes, best first; those that this version does not know are skipped.
    #[serde(deserialize_with = "known_codecs")]
    pub codecs: Vec<Codec>,
    /// Largest frame that it wants, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_px: Option<u64>,
    /// Device pixel ratio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dpr: Option<f32>,
    /// Whether the user prefers reduced motion.
    #[serde(default)]
    pub reduced_motion: bool,
}

/// Skips the codecs that this version does not know, so that newer clients can offer theirs.
fn known_codecs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Codec>, D::Error> {
    let names = Vec::<String>::deserialize(deserializer)?;
    let known = |name: String| Codec::deserialize(StrDeserializer::<ValueError>::new(&name)).ok();
    Ok(names.into_iter().filter_map(known).collect())
}

/// A new camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraInput {
    /// View.
    #[serde(default)]
    pub view: u16,
    /// Number of the input, rising by one over cameras and lights. A frame states the last input that it contains.
    pub seq: u32,
    /// Client's monotonic milliseconds.
    #[serde(default)]
    pub ts: f64,
    /// The camera.
    pub pose: Pose,
    /// Place in the gesture.
    pub phase: Phase,
}

/// An edit of lights. `move` previews, `end` commits; both are shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LightInput {
    /// Input number, shared with cameras.
    pub seq: u32,
    /// Client's monotonic milliseconds.
    #[serde(default)]
    pub ts: f64,
    /// The change.
    pub patch: LightPatch,
    /// Place in the gesture.
    pub phase: Phase,
}

/// Settings of a view; an absent field leaves its setting as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ViewSet {
    /// View.
    #[serde(default)]
    pub view: u16,
    /// Width, device pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub w: Option<u32>,
    /// Height, device pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub h: Option<u32>,
    /// Lowest JPEG quality while moving, 1 to 100.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_q: Option<u8>,
    /// Highest JPEG quality while moving, 1 to 100.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_q: Option<u8>,
    /// Target frame rate while moving, frames per second, 1 to 120.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<u16>,
    /// Codec of stills, among those offered in `hello`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub codec: Option<Codec>,
    /// Nothing is rendered or sent while true (hidden tab).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paused: Option<bool>,
    /// Exposure, linear factor in [1e-6, 1e6].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f32>,
    /// Technique id, among `welcome.techniques`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub technique: Option<String>,
    /// Output shown instead of radiance, among `welcome.outputs`; null goes back to radiance.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "present")]
    #[allow(clippy::option_option, reason = "absent leaves the setting as it is, null is a value")]
    pub aov: Option<Option<String>>,
    /// Refinement stops at this tone-mapped RMSE, in (0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_error: Option<f32>,
    /// Refinement stops at this number of samples a pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_spp: Option<u32>,
}

/// Tells a field that is null from one that is absent.
#[allow(clippy::option_option, reason = "the outer level is presence, the inner one null")]
fn present<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<String>>, D::Error> {
    let value = serde_json::Value::deserialize(deserializer)?;
    match value {
        serde_json::Value::Null => Ok(Some(None)),
        serde_json::Value::String(name) => Ok(Some(Some(name))),
        _ => Err(D::Error::custom("aov: expected the id of an output, or null")),
    }
}

/// Acknowledgement of all frames up to `seq`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Ack {
    /// View.
    #[serde(default)]
    pub view: u16,
    /// Newest `frame_seq` received.
    pub seq: u32,
    /// Decoding time of that frame, microseconds.
    #[serde(default)]
    pub decode_us: u32,
    /// Client's monotonic milliseconds at presentation.
    #[serde(default)]
    pub present_ms: f64,
    /// Frames received since the last acknowledgement and not shown.
    #[serde(default)]
    pub dropped: u32,
    /// Frames waiting to be decoded.
    #[serde(default)]
    pub queue: u32,
}
