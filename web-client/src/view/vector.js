/**
 * Three-component vectors as plain arrays, the form of the protocol.
 */

/** @typedef {import('../protocol/types.js').Vec3} Vec3 */

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/** @param {Vec3} a @param {number} factor @returns {Vec3} */
export const scale = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];

/** @param {Vec3} a @param {Vec3} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @param {Vec3} a */
export const length = (a) => Math.hypot(a[0], a[1], a[2]);

/**
 * Unit vector along `a`, or `fallback` if `a` has no direction.
 * @param {Vec3} a
 * @param {Vec3} [fallback]
 * @returns {Vec3}
 */
export function normalize(a, fallback = [0, 1, 0]) {
  const size = length(a);
  return size > 0 && Number.isFinite(size) ? scale(a, 1 / size) : fallback;
}

/**
 * Rotates `a` about the unit vector `axis`, counter-clockwise seen from its tip (Rodrigues' formula).
 * @param {Vec3} a
 * @param {Vec3} axis
 * @param {number} angle radians
 * @returns {Vec3}
 */
export function rotate(a, axis, angle) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  return add(add(scale(a, c), scale(cross(axis, a), s)), scale(axis, dot(axis, a) * (1 - c)));
}

/** @param {Vec3} a @param {Vec3} b @param {number} t @returns {Vec3} */
export const mix = (a, b, t) => add(scale(a, 1 - t), scale(b, t));
