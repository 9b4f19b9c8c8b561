//! Messages from the client to the server.

use serde::de::Error as _;
use serde::de::value::{Error as ValueError, StrDeserializer};
use serde::{Deserialize, Deserializer, Serialize};

use crate::settings::{Codec, LightPatch, Phase, Pose};

/// A control message with its optional request id; the id is repeated in `ok` and `error`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClientEnvelope {
    /// Request id chosen by the client.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<u64>,
    /// The message.
    #[serde(flatten)]
    pub message: ClientMessage,
}

/// What a client may say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "t")]
pub enum ClientMessage {
    /// First message, within [`crate::limits::Limits::hello_timeout_ms`].
    #[serde(rename = "hello")]
    Hello(Hello),
    /// New camera of a view.
    #[serde(rename = "camera")]
    Camera(CameraInput),
    /// Light edit.
    #[serde(rename = "light")]
    Light(LightInput),
    /// Size and wishes of a view.
    #[serde(rename = "view.set")]
    ViewSet(ViewSet),
    /// A frame arrived and was shown (cumulative).
    #[serde(rename = "ack")]
    Ack(Ack),
    /// Ask for a still of the present picture now.
    #[serde(rename = "still")]
    Still {
        /// View.
        #[serde(default)]
        view: u16,
    },
    /// What surface is under a pixel of the last shown frame (focus on double-click).
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
    /// Which surfels light the surface under a pixel of the last shown frame; answered by `inspected`.
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

/// Introduction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Protocol versions the client speaks.
    pub v: Vec<u32>,
    /// Program and version, for logs; at most 128 characters.
    #[serde(default)]
    pub client: String,
    /// What it can show.
    pub caps: Caps,
    /// Token of an earlier connection to take up again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resume: Option<String>,
}

/// Abilities of a client.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Caps {
    /// Codecs it decodes, best first; those this version does not know are skipped.
    #[serde(deserialize_with = "known_codecs")]
    pub codecs: Vec<Codec>,
    /// Largest picture it wants, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_px: Option<u64>,
    /// Device pixel ratio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dpr: Option<f32>,
    /// Prefers reduced motion.
    #[serde(default)]
    pub reduced_motion: bool,
}

/// Newer clients offer codecs of which this version has not heard; their other wishes still stand.
fn known_codecs<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Codec>, D::Error> {
    let names = Vec::<String>::deserialize(deserializer)?;
    let known = |name: String| Codec::deserialize(StrDeserializer::<ValueError>::new(&name)).ok();
    Ok(names.into_iter().filter_map(known).collect())
}

/// Camera input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraInput {
    /// View.
    #[serde(default)]
    pub view: u16,
    /// Input number, rising by one over cameras and lights; frames repeat the last one they contain.
    pub seq: u32,
    /// Client's monotonic milliseconds.
    #[serde(default)]
    pub ts: f64,
    /// The pose.
    pub pose: Pose,
    /// Where the gesture stands.
    pub phase: Phase,
}

/// Light input. `move` previews, `end` commits; both are shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightInput {
    /// Input number, shared with cameras.
    pub seq: u32,
    /// Client's monotonic milliseconds.
    #[serde(default)]
    pub ts: f64,
    /// The change.
    pub patch: LightPatch,
    /// Where the gesture stands.
    pub phase: Phase,
}

/// Wishes for a view; absent fields stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Frames per second aimed at while moving, 1 to 120.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<u16>,
    /// Codec wished for stills; must be among the offered ones.
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
    #[allow(clippy::option_option, reason = "absent leaves the view as it is, null is a wish of its own")]
    pub aov: Option<Option<String>>,
    /// Stop refining at this tone-mapped RMSE, in (0, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_error: Option<f32>,
    /// Stop refining at this many samples a pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_spp: Option<u32>,
}

/// Tells a null, which was said, from a field that was not.
#[allow(clippy::option_option, reason = "that is what it tells apart")]
fn present<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Option<String>>, D::Error> {
    let value = serde_json::Value::deserialize(deserializer)?;
    match value {
        serde_json::Value::Null => Ok(Some(None)),
        serde_json::Value::String(name) => Ok(Some(Some(name))),
        _ => Err(D::Error::custom("aov: expected the id of an output, or null")),
    }
}

/// Acknowledgement of all frames up to `seq`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Frames received but not shown since the last ack.
    #[serde(default)]
    pub dropped: u32,
    /// Frames waiting for decoding.
    #[serde(default)]
    pub queue: u32,
}
