//! Messages from the server to the client.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inspection::Inspection;
use crate::limits::Limits;
use crate::settings::{LightState, NamedPose};

/// A control message from the server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "t")]
pub enum ServerMessage {
    /// Answer to `hello`.
    #[serde(rename = "welcome")]
    Welcome(Box<Welcome>),
    /// The lights of the session, after `welcome` and after every edit by any member.
    #[serde(rename = "lights")]
    Lights {
        /// Scene revision that contains the change.
        scene_rev: u32,
        /// All lights.
        #[serde(flatten)]
        state: LightState,
    },
    /// How a view is served, so that the user interface can say why the image is soft. At most twice a second.
    #[serde(rename = "stats")]
    Stats(Box<Stats>),
    /// An event that the user should know of.
    #[serde(rename = "notice")]
    Notice {
        /// What happened.
        kind: NoticeKind,
        /// Text for people.
        detail: String,
    },
    /// A request with an id was carried out.
    #[serde(rename = "ok")]
    Ok {
        /// The request's id.
        re: u64,
    },
    /// Answer to `pick`.
    #[serde(rename = "picked")]
    Picked {
        /// The request's id.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        re: Option<u64>,
        /// World position of the surface; absent where the ray leaves the scene.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position: Option<[f64; 3]>,
        /// Name of the object.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        object: Option<String>,
    },
    /// Answer to `inspect`.
    #[serde(rename = "inspected")]
    Inspected {
        /// The request's id.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        re: Option<u64>,
        /// What lights the point; null where the ray leaves the scene or no technique of the session knows of it.
        inspection: Option<Box<Inspection>>,
    },
    /// A message was refused; the connection stays.
    #[serde(rename = "error")]
    Error {
        /// The request's id, where it had one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        re: Option<u64>,
        /// Machine-readable code, the same registry as HTTP problems.
        code: String,
        /// Text for people: the field, the limit, the remedy.
        detail: String,
    },
    /// Application-level ping.
    #[serde(rename = "ping")]
    Ping {
        /// Server's monotonic milliseconds.
        ts: f64,
    },
    /// Answer to the client's `ping`.
    #[serde(rename = "pong")]
    Pong {
        /// The client's `ts`.
        ts: f64,
        /// Server's monotonic milliseconds.
        server_ms: f64,
    },
}

/// Answer to `hello`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Welcome {
    /// Protocol version in use.
    pub v: u32,
    /// Connection id, for logs.
    pub conn: String,
    /// Session.
    pub session: SessionInfo,
    /// Limits in force.
    pub limits: Limits,
    /// Available techniques, the default first.
    pub techniques: Vec<TechniqueInfo>,
    /// Outputs that a view can show instead of radiance.
    #[serde(default)]
    pub outputs: Vec<OutputInfo>,
    /// Cameras of the scene.
    pub cameras: Vec<NamedPose>,
    /// Centre of the scene's bounds, world space.
    pub center: [f64; 3],
    /// Radius of the sphere around the scene, metres.
    pub radius: f64,
    /// Warnings of the scene's import.
    pub warnings: Vec<String>,
    /// Server's monotonic milliseconds.
    pub server_ms: f64,
    /// Token for `hello.resume`; changes at every connection.
    pub resume_token: String,
    /// Time for which the view can be resumed after the connection ends, milliseconds.
    pub grace_ms: u32,
    /// Server's program version.
    pub server: String,
    /// Name of the render device.
    pub device: String,
}

/// The session a connection joined.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SessionInfo {
    /// Session id.
    pub id: String,
    /// Scene id (`sha256:...`).
    pub scene: String,
    /// Scene name for people.
    pub scene_name: String,
    /// Revision of scene and lights.
    pub scene_rev: u32,
    /// Rises when the render device was lost and rebuilt.
    pub epoch: u32,
    /// Triangles in the scene.
    pub triangle_count: u32,
}

/// An available technique.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TechniqueInfo {
    /// Id for `view.set`.
    pub id: String,
    /// Name for people.
    pub label: String,
    /// One sentence of description.
    pub summary: String,
    /// Its settings, which a render request sets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub settings: Vec<SettingInfo>,
    /// Named values of the settings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub presets: Vec<PresetInfo>,
}

/// A setting of a technique.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SettingInfo {
    /// Name in requests.
    pub id: String,
    /// Name for people.
    pub label: String,
    /// What a larger value or each choice buys, and what it costs.
    pub help: String,
    /// Unit of a number; empty without one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// What it takes.
    pub kind: SettingKind,
    /// Value where none is given: that for which the id of the technique stands.
    pub default: SettingValue,
    /// Smallest and largest value of a number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Whether a number has to be whole.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_integer: bool,
    /// Names that a choice takes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
}

/// What a setting takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SettingKind {
    /// A number within `range`.
    Number,
    /// True or false.
    Switch,
    /// One of `names`.
    Choice,
}

/// Value of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SettingValue {
    /// Of a switch.
    Switch(bool),
    /// Of a number.
    Number(f64),
    /// Of a choice.
    Choice(String),
}

/// Values of several settings under one name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PresetInfo {
    /// Name in requests.
    pub id: String,
    /// What it sets, by the ids of settings.
    pub values: BTreeMap<String, SettingValue>,
}

/// An output that a view can show instead of radiance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OutputInfo {
    /// Id for `view.set`.
    pub id: String,
    /// Name for people.
    pub label: String,
    /// What its numbers mean, with their unit.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub help: String,
    /// Technique that alone has it; absent where all have. A view of another one shows radiance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub technique: Option<String>,
}

/// What happened that the user should know of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoticeKind {
    /// The server is stopping.
    Draining,
    /// The render device was lost; frames pause.
    DeviceLost,
    /// The render device is back.
    Restored,
    /// A quota or memory bound was reached.
    Quota,
}

/// State of one view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stats {
    /// View.
    pub view: u16,
    /// JPEG quality in use while moving.
    pub quality: u8,
    /// Resolution factor of the newest moving frame, in (0, 1]; before the first, the one that the link allows.
    pub scale: f32,
    /// Frames per second sent over the last second.
    pub fps: f32,
    /// Frames that may be in flight.
    pub window: u32,
    /// Smallest round trip of the last 10 s, milliseconds.
    pub rtt_ms: f32,
    /// What keeps quality or scale below the settings: `device` where the renderer lowered the scale to hold the frame
    /// time, otherwise `link` where rate control lowered either; empty where neither did.
    pub reason: String,
    /// Samples a pixel of the newest frame.
    pub samples: u32,
    /// Audited error of the newest audited frame; absent while the view shows another output than radiance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<ErrorInfo>,
    /// Whether refinement has ended, so that no frame follows.
    pub converged: bool,
    /// Passes of the newest frame.
    pub passes: Vec<PassInfo>,
    /// Passes that did not run, with the reason.
    pub skipped: Vec<SkippedInfo>,
}

/// Audited error of an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorInfo {
    /// Tone-mapped RMSE.
    pub rmse: f32,
    /// Its standard error.
    pub std_error: f32,
}

/// A pass that ran.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PassInfo {
    /// Name of the pass, which is that of its kernel and file.
    pub name: String,
    /// Time on the device, milliseconds.
    pub ms: f32,
}

/// A pass that did not run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SkippedInfo {
    /// Pass.
    pub name: String,
    /// Reason.
    pub reason: String,
}
