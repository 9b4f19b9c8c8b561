/**
 * Control messages: JSON objects told apart by `t`. Mirrors
 * `protocol/src/{client,server,settings,inspection,limits}.rs`.
 */

import { boolean, list, number, object, optional, string } from './shape.js';

/** WebSocket subprotocol of this version. */
export const SUBPROTOCOL = 'surfelcast.v1.json';

/** Protocol version in `hello` and `welcome`. */
export const VERSION = 1;

/** @typedef {'jpeg' | 'webp' | 'png'} Codec */
/** @typedef {'start' | 'move' | 'end'} Phase a newer `move` may replace an older one; `start` and `end` are kept */
/** @typedef {[number, number, number]} Vec3 */
/** @typedef {{ eye: Vec3, target: Vec3, up: Vec3, vfov_deg: number }} Pose world space, metres, degrees */
/** @typedef {{ name: string, pose: Pose, exposure: number }} NamedPose */

/**
 * @typedef {object} Light
 * @property {number} id stable within the session
 * @property {string} name
 * @property {'point' | 'spot' | 'directional'} kind
 * @property {Vec3} position world space, metres
 * @property {Vec3} direction in which it shines
 * @property {Vec3} color linear, each in [0, 1]
 * @property {number} intensity W/sr, or W/m² for directional lights
 * @property {[number, number] | null} [cone_deg] inner and outer half angle of a spot
 * @property {boolean} enabled
 */

/**
 * @typedef {object} LightPatch absent fields stay as they are
 * @property {Light} [add]
 * @property {Light} [set]
 * @property {number} [remove]
 * @property {number} [environment_strength]
 * @property {number} [emissive_strength]
 */

/**
 * @typedef {object} ViewSettings absent fields stay as they are
 * @property {number} [w] device pixels
 * @property {number} [h] device pixels
 * @property {boolean} [paused]
 * @property {number} [exposure] linear factor
 * @property {string} [technique]
 * @property {string | null} [aov] output shown instead of radiance; null goes back to radiance
 * @property {number} [max_error]
 * @property {number} [max_spp]
 * @property {number} [fps]
 */

/**
 * @typedef {object} Limits
 * @property {number} inputs_per_sec
 * @property {number} max_side
 * @property {number} max_pixels
 * @property {number} max_lights
 */

/** @typedef {{ id: string, label: string, summary: string }} Technique */
/** @typedef {{ id: string, label: string }} Output what a view can show instead of radiance */

/**
 * @typedef {object} Welcome
 * @property {'welcome'} t
 * @property {number} v
 * @property {string} conn
 * @property {{ id: string, scene: string, scene_name: string, scene_rev: number, epoch: number, triangle_count: number }} session
 * @property {Limits} limits
 * @property {Technique[]} techniques default first
 * @property {Output[]} outputs none from servers that have none to offer
 * @property {NamedPose[]} cameras
 * @property {Vec3} center
 * @property {number} radius metres
 * @property {string[]} warnings
 * @property {string} resume_token
 * @property {number} grace_ms
 * @property {string} server
 * @property {string} device
 */

/** @typedef {{ lights: Light[], environment_strength: number, emissive_strength: number, has_environment: boolean }} LightState */
/** @typedef {{ t: 'lights', scene_rev: number } & LightState} LightsMessage */

/**
 * @typedef {object} Stats
 * @property {'stats'} t
 * @property {number} view
 * @property {number} quality
 * @property {number} scale of the newest frame of a gesture, in (0, 1]
 * @property {number} fps
 * @property {number} rtt_ms
 * @property {string} reason what keeps quality or scale down: `device`, `link` or nothing
 * @property {number} samples
 * @property {{ rmse: number, std_error: number } | null} [error]
 * @property {boolean} converged
 * @property {{ name: string, ms: number }[]} passes
 * @property {{ name: string, reason: string }[]} skipped
 */

/** @typedef {'draining' | 'device_lost' | 'restored' | 'quota'} NoticeKind */
/** @typedef {{ t: 'notice', kind: NoticeKind, detail: string }} Notice */
/** @typedef {{ t: 'picked', re?: number | null, position?: Vec3 | null, object?: string | null }} Picked */
/**
 * @typedef {object} Contribution one surfel's part in a point's light
 * @property {number} id
 * @property {number} share of the point's value; all add up to one
 * @property {number} weight by distance and normal
 * @property {number} visibility chance that it sees the point
 * @property {Vec3} position world space, metres
 * @property {Vec3} normal
 * @property {number} radius metres
 * @property {Vec3} direct B of sky and emission found directly
 * @property {Vec3} indirect B of light that has bounced
 * @property {number} ray_count
 * @property {number} std_error of the luminance of B
 */
/**
 * @typedef {object} Inspection what the surfel cache knows of a point
 * @property {Vec3} position world space, metres
 * @property {Vec3} normal towards the viewer
 * @property {number} coverage sum of weights
 * @property {number} trust sum of weights that also count visibility and rays
 * @property {Vec3} direct B (irradiance over pi) of sky and emission found directly
 * @property {Vec3} indirect B of light that has bounced
 * @property {Contribution[]} contributions largest share first
 */
/** @typedef {{ t: 'inspected', re?: number | null, inspection?: Inspection | null }} Inspected */
/** @typedef {{ t: 'error', re?: number | null, code: string, detail: string }} Refusal */
/** @typedef {{ t: 'ok', re: number } | { t: 'ping', ts: number } | { t: 'pong', ts: number }} Housekeeping */
/** @typedef {Welcome | LightsMessage | Stats | Notice | Picked | Inspected | Refusal | Housekeeping} ServerMessage */

/** @typedef {{ codecs: Codec[], max_px?: number, dpr?: number, reduced_motion: boolean }} Caps */
/**
 * @typedef {{ id?: number } & (
 *   | { t: 'hello', v: number[], client: string, caps: Caps, resume?: string }
 *   | { t: 'camera', view: number, seq: number, ts: number, pose: Pose, phase: Phase }
 *   | { t: 'light', seq: number, ts: number, patch: LightPatch, phase: Phase }
 *   | ({ t: 'view.set', view: number } & ViewSettings)
 *   | { t: 'ack', view: number, seq: number, decode_us: number, present_ms: number, dropped: number, queue: number }
 *   | { t: 'still', view: number }
 *   | { t: 'pick', view: number, x: number, y: number }
 *   | { t: 'inspect', view: number, x: number, y: number }
 *   | { t: 'ping', ts: number }
 *   | { t: 'pong', ts: number }
 * )} ClientMessage
 */

const vec3 = list(number, 3);
const pose = object({ eye: vec3, target: vec3, up: vec3, vfov_deg: number });
const light = object({
  id: number,
  name: string,
  kind: string,
  position: vec3,
  direction: vec3,
  color: vec3,
  intensity: number,
  cone_deg: optional(list(number, 2)),
});

const lightThere = { position: vec3, normal: vec3, direct: vec3, indirect: vec3 };
const contribution = object({
  id: number,
  share: number,
  weight: number,
  visibility: number,
  radius: number,
  ray_count: number,
  std_error: number,
  ...lightThere,
});
const inspection = object({ coverage: number, trust: number, contributions: list(contribution), ...lightThere });

/** What this client understands, by type. @type {Record<string, import('./shape.js').Shape>} */
export const SHAPES = {
  welcome: object({
    v: number,
    conn: string,
    session: object({ id: string, scene: string, scene_name: string, scene_rev: number, triangle_count: number }),
    limits: object({ inputs_per_sec: number, max_side: number, max_pixels: number, max_lights: number }),
    techniques: list(object({ id: string, label: string, summary: string })),
    outputs: optional(list(object({ id: string, label: string }))),
    cameras: list(object({ name: string, pose, exposure: number })),
    center: vec3,
    radius: number,
    warnings: list(string),
    resume_token: string,
    server: string,
    device: string,
  }),
  lights: object({
    lights: list(light),
    environment_strength: number,
    emissive_strength: number,
    has_environment: boolean,
  }),
  stats: object({
    quality: number,
    scale: number,
    fps: number,
    reason: string,
    samples: number,
    error: optional(object({ rmse: number, std_error: number })),
    converged: boolean,
    passes: list(object({ name: string, ms: number })),
    skipped: list(object({ name: string, reason: string })),
  }),
  notice: object({ kind: string, detail: string }),
  picked: object({ re: optional(number), position: optional(vec3), object: optional(string) }),
  inspected: object({ re: optional(number), inspection: optional(inspection) }),
  error: object({ code: string, detail: string }),
  ok: object({ re: number }),
  ping: object({ ts: number }),
  pong: object({ ts: number }),
};

/** Why a text message was not understood. */
export class MessageError extends Error {
  name = 'MessageError';
}

/**
 * Reads a text message.
 * @param {string} text
 * @returns {ServerMessage | undefined} nothing for a type that a newer server may send
 * @throws {MessageError} where it is malformed
 */
export function parseServerMessage(text) {
  let value;
  try {
    value = JSON.parse(text);
  } catch {
    throw new MessageError('message is not JSON');
  }
  const type = value?.t;
  if (typeof type !== 'string') throw new MessageError('message has no type `t`');
  const shape = Object.hasOwn(SHAPES, type) ? SHAPES[type] : undefined;
  if (!shape) return undefined;
  const wrong = shape(value, type);
  if (wrong) throw new MessageError(wrong);
  if (type === 'welcome') value.outputs ??= [];
  if (type === 'lights') for (const entry of value.lights) entry.enabled ??= true;
  return value;
}
