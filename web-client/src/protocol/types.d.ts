/**
 * Generated from protocol/src by protocol/tests/page_types.rs. Do not edit: change the Rust types, then run
 * `SURFELCAST_UPDATE=1 cargo nextest run --release -p surfelcast-protocol --test page_types`.
 */

export type Vec3 = [number, number, number];

/** Acknowledgement of all frames up to `seq`. */
export interface Ack {
  /** Decoding time of that frame, microseconds. */
  decode_us: number;
  /** Frames received since the last acknowledgement and not shown. */
  dropped: number;
  /** Client's monotonic milliseconds at presentation. */
  present_ms: number;
  /** Frames waiting to be decoded. */
  queue: number;
  /** Newest `frame_seq` received. */
  seq: number;
  /** View. */
  view: number;
}

/** A new camera. */
export interface CameraInput {
  /** Place in the gesture. */
  phase: Phase;
  /** The camera. */
  pose: Pose;
  /** Number of the input, rising by one over cameras and lights. A frame states the last input that it contains. */
  seq: number;
  /** Client's monotonic milliseconds. */
  ts: number;
  /** View. */
  view: number;
}

/** Capabilities of a client. */
export interface Caps {
  /** Codecs that it decodes, best first; those that this version does not know are skipped. */
  codecs: Codec[];
  /** Device pixel ratio. */
  dpr?: number | null;
  /** Largest frame that it wants, pixels. */
  max_px?: number | null;
  /** Whether the user prefers reduced motion. */
  reduced_motion: boolean;
}

/** A control message with its optional request id, which the answer repeats. */
export type ClientMessage = {
  /** Request id chosen by the client. */
  id?: number | null;
} & (
  /** The first message, due within [`crate::limits::Limits::hello_timeout_ms`]. */
  | ({ t: 'hello' } & Hello)
  /** New camera of a view. */
  | ({ t: 'camera' } & CameraInput)
  /** Edit of the session's lights. */
  | ({ t: 'light' } & LightInput)
  /** New settings of a view. */
  | ({ t: 'view.set' } & ViewSet)
  /** Acknowledges a frame and all before it. */
  | ({ t: 'ack' } & Ack)
  /** Requests a still of the present frame. */
  | {
    t: 'still';
    /** View. */
    view: number;
  }
  /** Which surface is at a point of the last acknowledged frame; answered by `picked`. */
  | {
    t: 'pick';
    /** View. */
    view: number;
    /** Horizontal position, 0 (left) to 1. */
    x: number;
    /** Vertical position, 0 (top) to 1. */
    y: number;
  }
  /** What lights the surface at a point of the last acknowledged frame, as a technique explains it; answered by
   * `inspected`. */
  | {
    t: 'inspect';
    /** View. */
    view: number;
    /** Horizontal position, 0 (left) to 1. */
    x: number;
    /** Vertical position, 0 (top) to 1. */
    y: number;
  }
  /** Application-level ping; answered by `pong` with the same `ts`. */
  | {
    t: 'ping';
    /** Client's monotonic milliseconds. */
    ts: number;
  }
  /** Answer to the server's `ping`. */
  | {
    t: 'pong';
    /** The server's `ts`. */
    ts: number;
  }
);

/** Image codec; the number is the header's `codec` byte. */
export type Codec = 'jpeg' | 'webp' | 'png';

/** What the values of a column mean. */
export interface Column {
  /** Machine-readable name. */
  id: string;
  /** Name for people. */
  label: string;
  /** Unit; empty without one. `share`: a number in [0, 1], to be shown as percent; `count`: a whole number. */
  unit?: string;
}

/** A disc in the scene. */
export interface Disc {
  /** World space. */
  normal: Vec3;
  /** Centre, world space, metres. */
  position: Vec3;
  /** Metres. */
  radius: number;
}

/** Audited error of an image. */
export interface ErrorInfo {
  /** Tone-mapped RMSE. */
  rmse: number;
  /** Its standard error. */
  std_error: number;
}

/** A figure by name. */
export interface Field {
  /** Machine-readable name. */
  id: string;
  /** Name for people. */
  label: string;
  /** Unit; empty without one. */
  unit?: string;
  /** The figure. */
  value: FieldValue;
}

/** A number, or three of them: a colour or a vector. */
export type FieldValue = number | Vec3;

/** What a client states about itself. */
export interface Hello {
  /** What it can decode and show. */
  caps: Caps;
  /** Program and version, for logs; at most 128 characters. */
  client: string;
  /** Token of an earlier connection whose view is resumed. */
  resume?: string | null;
  /** Protocol versions that the client supports. */
  v: number[];
}

/** What a technique knows of the surface under a point of the image. */
export interface Inspection {
  /** What the rows' values mean. */
  columns: Column[];
  /** What was found, in one sentence. */
  headline: string;
  /** World space, towards the viewer. */
  normal: Vec3;
  /** World space, metres. */
  position: Vec3;
  /** What is behind the figures, the most important first. */
  rows: Row[];
  /** Figures of the point. */
  summary: Field[];
}

/** A punctual light of the session. */
export interface Light {
  /** Linear colour, each in [0, 1]. */
  color: Vec3;
  /** Spot cone half angles `[inner, outer]`, degrees. */
  cone_deg?: [number, number] | null;
  /** Direction in which it shines, world space, any length (unused by point lights). */
  direction: Vec3;
  /** Whether it shines; a light that is off stays listed. */
  enabled: boolean;
  /** Stable id within the session. */
  id: number;
  /** W/sr (point, spot) or W/m^2 (directional). */
  intensity: number;
  /** Kind. */
  kind: LightKind;
  /** Name shown to people. */
  name: string;
  /** World position, metres (unused by directional lights). */
  position: Vec3;
}

/** An edit of lights. `move` previews, `end` commits; both are shown. */
export interface LightInput {
  /** The change. */
  patch: LightPatch;
  /** Place in the gesture. */
  phase: Phase;
  /** Input number, shared with cameras. */
  seq: number;
  /** Client's monotonic milliseconds. */
  ts: number;
}

/** Kind of a punctual light. */
export type LightKind = 'point' | 'spot' | 'directional';

/** An edit of the session's lights; an absent field changes nothing. */
export interface LightPatch {
  /** Add this light; the server assigns its `id`. */
  add?: Light | null;
  /** Factor on all emissive surfaces, in [0, 1e6]. */
  emissive_strength?: number | null;
  /** Factor on the environment's radiance, in [0, 1e6]. */
  environment_strength?: number | null;
  /** Remove the light of this id. */
  remove?: number | null;
  /** Replace the light of the same id. */
  set?: Light | null;
}

/** Limits on a connection, its view and its session. */
export interface Limits {
  /** Bytes of a control message. */
  control_bytes: number;
  /** Bytes of a message before `welcome`. */
  hello_bytes: number;
  /** Time within which `hello` must arrive, milliseconds. */
  hello_timeout_ms: number;
  /** Inputs per second of a connection. */
  inputs_per_sec: number;
  /** Punctual lights of a session. */
  max_lights: number;
  /** Pixels of a view. */
  max_pixels: number;
  /** Width or height of a view, pixels. */
  max_side: number;
  /** Views of a session. */
  views_per_session: number;
}

/** A named camera of the scene. */
export interface NamedPose {
  /** Exposure that its author intended, linear factor. */
  exposure: number;
  /** Name. */
  name: string;
  /** Pose. */
  pose: Pose;
}

/** What happened that the user should know of. */
export type NoticeKind = 'draining' | 'device_lost' | 'restored' | 'quota';

/** An output that a view can show instead of radiance. */
export interface OutputInfo {
  /** What its numbers mean, with their unit. */
  help?: string;
  /** Id for `view.set`. */
  id: string;
  /** Name for people. */
  label: string;
  /** Technique that alone has it; absent where all have. A view of another one shows radiance. */
  technique?: string | null;
}

/** A pass that ran. */
export interface PassInfo {
  /** Time on the device, milliseconds. */
  ms: number;
  /** Name of the pass, which is that of its kernel and file. */
  name: string;
}

/** Place of an input in its gesture. `start` and `end` are always sent; a newer `move` may replace a `move`. */
export type Phase = 'start' | 'move' | 'end';

/** Absolute camera pose in world space. Metres; right-handed, +Y usually up. */
export interface Pose {
  /** Eye. */
  eye: Vec3;
  /** Point that the camera looks at. */
  target: Vec3;
  /** Up direction, any length. */
  up: Vec3;
  /** Vertical field of view, degrees, in (0, 180). */
  vfov_deg: number;
}

/** Values of several settings under one name. */
export interface PresetInfo {
  /** Name in requests. */
  id: string;
  /** What it sets, by the ids of settings. */
  values: Record<string, SettingValue>;
}

/** One contribution. */
export interface Row {
  /** Where it lies, to be drawn into the image. */
  disc?: Disc | null;
  /** One value a column. */
  values: FieldValue[];
}

/** A control message from the server. */
export type ServerMessage =
  /** Answer to `hello`. */
  | ({ t: 'welcome' } & Welcome)
  /** The lights of the session, after `welcome` and after every edit by any member. */
  | {
    t: 'lights';
    /** Factor on emissive surfaces. */
    emissive_strength: number;
    /** Factor on the environment. */
    environment_strength: number;
    /** Whether the scene has an environment. */
    has_environment: boolean;
    /** Punctual lights, the scene's own first. */
    lights: Light[];
    /** Scene revision that contains the change. */
    scene_rev: number;
  }
  /** How a view is served, so that the user interface can say why the image is soft. At most twice a second. */
  | ({ t: 'stats' } & Stats)
  /** An event that the user should know of. */
  | {
    t: 'notice';
    /** Text for people. */
    detail: string;
    /** What happened. */
    kind: NoticeKind;
  }
  /** A request with an id was carried out. */
  | {
    t: 'ok';
    /** The request's id. */
    re: number;
  }
  /** Answer to `pick`. */
  | {
    t: 'picked';
    /** Name of the object. */
    object?: string | null;
    /** World position of the surface; absent where the ray leaves the scene. */
    position?: Vec3 | null;
    /** The request's id. */
    re?: number | null;
  }
  /** Answer to `inspect`. */
  | {
    t: 'inspected';
    /** What lights the point; null where the ray leaves the scene or no technique of the session knows of it. */
    inspection: Inspection | null;
    /** The request's id. */
    re?: number | null;
  }
  /** A message was refused; the connection stays. */
  | {
    t: 'error';
    /** Machine-readable code, the same registry as HTTP problems. */
    code: string;
    /** Text for people: the field, the limit, the remedy. */
    detail: string;
    /** The request's id, where it had one. */
    re?: number | null;
  }
  /** Application-level ping. */
  | {
    t: 'ping';
    /** Server's monotonic milliseconds. */
    ts: number;
  }
  /** Answer to the client's `ping`. */
  | {
    t: 'pong';
    /** Server's monotonic milliseconds. */
    server_ms: number;
    /** The client's `ts`. */
    ts: number;
  };

/** The session a connection joined. */
export interface SessionInfo {
  /** Rises when the render device was lost and rebuilt. */
  epoch: number;
  /** Session id. */
  id: string;
  /** Scene id (`sha256:...`). */
  scene: string;
  /** Scene name for people. */
  scene_name: string;
  /** Revision of scene and lights. */
  scene_rev: number;
  /** Triangles in the scene. */
  triangle_count: number;
}

/** A setting of a technique. */
export interface SettingInfo {
  /** Value where none is given: that for which the id of the technique stands. */
  default: SettingValue;
  /** What a larger value or each choice buys, and what it costs. */
  help: string;
  /** Name in requests. */
  id: string;
  /** Whether a number has to be whole. */
  is_integer?: boolean;
  /** What it takes. */
  kind: SettingKind;
  /** Name for people. */
  label: string;
  /** Names that a choice takes. */
  names?: string[];
  /** Smallest and largest value of a number. */
  range?: [number, number] | null;
  /** Unit of a number; empty without one. */
  unit?: string;
}

/** What a setting takes. */
export type SettingKind = 'number' | 'switch' | 'choice';

/** Value of a setting. */
export type SettingValue = boolean | number | string;

/** A pass that did not run. */
export interface SkippedInfo {
  /** Pass. */
  name: string;
  /** Reason. */
  reason: string;
}

/** State of one view. */
export interface Stats {
  /** Whether refinement has ended, so that no frame follows. */
  converged: boolean;
  /** Audited error of the newest audited frame; absent while the view shows another output than radiance. */
  error?: ErrorInfo | null;
  /** Frames per second sent over the last second. */
  fps: number;
  /** Passes of the newest frame. */
  passes: PassInfo[];
  /** JPEG quality in use while moving. */
  quality: number;
  /** What keeps quality or scale below the settings: `device` where the renderer lowered the scale to hold the frame
   * time, otherwise `link` where rate control lowered either; empty where neither did. */
  reason: string;
  /** Smallest round trip of the last 10 s, milliseconds. */
  rtt_ms: number;
  /** Samples a pixel of the newest frame. */
  samples: number;
  /** Resolution factor of the newest moving frame, in (0, 1]; before the first, the one that the link allows. */
  scale: number;
  /** Passes that did not run, with the reason. */
  skipped: SkippedInfo[];
  /** View. */
  view: number;
  /** Frames that may be in flight. */
  window: number;
}

/** An available technique. */
export interface TechniqueInfo {
  /** Id for `view.set`. */
  id: string;
  /** Name for people. */
  label: string;
  /** Named values of the settings. */
  presets?: PresetInfo[];
  /** Its settings, which a render request sets. */
  settings?: SettingInfo[];
  /** One sentence of description. */
  summary: string;
}

/** Settings of a view; an absent field leaves its setting as it is. */
export interface ViewSet {
  /** Output shown instead of radiance, among `welcome.outputs`; null goes back to radiance. */
  aov?: string | null;
  /** Codec of stills, among those offered in `hello`. */
  codec?: Codec | null;
  /** Exposure, linear factor in [1e-6, 1e6]. */
  exposure?: number | null;
  /** Target frame rate while moving, frames per second, 1 to 120. */
  fps?: number | null;
  /** Height, device pixels. */
  h?: number | null;
  /** Refinement stops at this tone-mapped RMSE, in (0, 1]. */
  max_error?: number | null;
  /** Highest JPEG quality while moving, 1 to 100. */
  max_q?: number | null;
  /** Refinement stops at this number of samples a pixel. */
  max_spp?: number | null;
  /** Lowest JPEG quality while moving, 1 to 100. */
  min_q?: number | null;
  /** Nothing is rendered or sent while true (hidden tab). */
  paused?: boolean | null;
  /** Technique id, among `welcome.techniques`. */
  technique?: string | null;
  /** View. */
  view: number;
  /** Width, device pixels. */
  w?: number | null;
}

/** Answer to `hello`. */
export interface Welcome {
  /** Cameras of the scene. */
  cameras: NamedPose[];
  /** Centre of the scene's bounds, world space. */
  center: Vec3;
  /** Connection id, for logs. */
  conn: string;
  /** Name of the render device. */
  device: string;
  /** Time for which the view can be resumed after the connection ends, milliseconds. */
  grace_ms: number;
  /** Limits in force. */
  limits: Limits;
  /** Outputs that a view can show instead of radiance. */
  outputs: OutputInfo[];
  /** Radius of the sphere around the scene, metres. */
  radius: number;
  /** Token for `hello.resume`; changes at every connection. */
  resume_token: string;
  /** Server's program version. */
  server: string;
  /** Server's monotonic milliseconds. */
  server_ms: number;
  /** Session. */
  session: SessionInfo;
  /** Available techniques, the default first. */
  techniques: TechniqueInfo[];
  /** Protocol version in use. */
  v: number;
  /** Warnings of the scene's import. */
  warnings: string[];
}
