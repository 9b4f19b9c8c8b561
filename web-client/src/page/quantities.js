/**
 * Conversions between the units of the protocol and those of the fields.
 */

/** @typedef {import('../protocol/types.js').Vec3} Vec3 */

/** @param {number} factor linear */
export const evOf = (factor) => Math.log2(factor);

/** @param {number} ev */
export const factorOf = (ev) => 2 ** ev;

/**
 * Linear Rec. 709 to the `#rrggbb` of a colour field.
 * @param {Vec3} color
 */
export function hexOf(color) {
  return `#${color.map((part) => Math.round(encode(Math.min(1, Math.max(0, part))) * 255).toString(16).padStart(2, '0')).join('')}`;
}

/**
 * `#rrggbb` to linear Rec. 709.
 * @param {string} hex
 * @returns {Vec3}
 */
export function colorOf(hex) {
  /** @param {number} at */
  const part = (at) => decode(Number.parseInt(hex.slice(at, at + 2), 16) / 255);
  return [part(1), part(3), part(5)];
}

/** @param {number} linear */
const encode = (linear) => (linear <= 0.0031308 ? linear * 12.92 : 1.055 * linear ** (1 / 2.4) - 0.055);
/** @param {number} encoded */
const decode = (encoded) => (encoded <= 0.04045 ? encoded / 12.92 : ((encoded + 0.055) / 1.055) ** 2.4);

/**
 * The direction to a light, in degrees: azimuth from -Z ("north") towards +X ("east"), elevation above the XZ plane.
 * @param {Vec3} direction in which the light shines, any length
 */
export function skyAngles(direction) {
  const [x, y, z] = direction;
  const flat = Math.hypot(x, z);
  const azimuth = flat > 0 ? (Math.atan2(-x, z) * 180) / Math.PI : 0;
  return { azimuth: (azimuth + 360) % 360, elevation: (Math.atan2(-y, flat) * 180) / Math.PI };
}

/**
 * Unit direction in which a light at these angles shines.
 * @param {{ azimuth: number, elevation: number }} angles degrees
 * @returns {Vec3}
 */
export function directionOf({ azimuth, elevation }) {
  const a = (azimuth * Math.PI) / 180;
  const e = (elevation * Math.PI) / 180;
  return [-Math.sin(a) * Math.cos(e), -Math.sin(e), Math.cos(a) * Math.cos(e)];
}

/**
 * Logarithmic scale of a slider. Its lowest position is zero.
 * @param {number} lowest smallest value above zero
 * @param {number} highest
 * @param {number} steps positions of the slider
 */
export function logScale(lowest, highest, steps) {
  const span = Math.log(highest / lowest);
  return {
    /** @param {number} position */
    value: (position) => (position <= 0 ? 0 : lowest * Math.exp((span * Math.min(position, steps)) / steps)),
    /** @param {number} value */
    position: (value) => (value <= lowest ? 0 : Math.min(steps, Math.round((Math.log(value / lowest) / span) * steps))),
  };
}
