/**
 * Camera movements as pure functions from pose to pose. World space, metres; angles in radians, right-handed.
 * `up` of a pose is the axis of orbiting, as the scene gives it; no movement changes it.
 */

import { add, cross, dot, length, mix, normalize, rotate, scale, subtract } from './vector.js';

/** @typedef {import('../protocol/types.js').Pose} Pose */
/** @typedef {import('../protocol/types.js').Vec3} Vec3 */

/** Least angle between view direction and up axis; at the pole itself "right" is undefined. */
const POLE_MARGIN = 0.01;

/**
 * Right, up and forward unit vectors of the image.
 * @param {Pose} pose
 */
export function basis(pose) {
  const forward = normalize(subtract(pose.target, pose.eye), [0, 0, -1]);
  const up = normalize(pose.up);
  const side = cross(forward, up);
  // Any perpendicular, if the view direction is the axis.
  const right = length(side) > 1e-9 ? normalize(side) : normalize(cross(forward, Math.abs(forward[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1]));
  return { right, up: cross(right, forward), forward };
}

/**
 * Turns `offset` by `azimuth` about the up axis and by `polar` towards it, stopping short of the poles.
 * @param {Pose} pose
 * @param {Vec3} offset
 * @param {number} azimuth
 * @param {number} polar positive raises the tip
 */
function turn(pose, offset, azimuth, polar) {
  const up = normalize(pose.up);
  const { right } = basis(pose);
  const elevation = Math.asin(Math.max(-1, Math.min(1, dot(normalize(offset), up))));
  const limit = Math.PI / 2 - POLE_MARGIN;
  const reached = Math.max(-limit, Math.min(limit, elevation + polar));
  // `right` belongs to the view direction; seen from the target, raising the eye turns the other way.
  const towardsView = dot(offset, subtract(pose.target, pose.eye)) >= 0 ? 1 : -1;
  return rotate(rotate(offset, right, (reached - elevation) * towardsView), up, azimuth);
}

/**
 * Moves the eye around the target.
 * @param {Pose} pose
 * @param {number} azimuth positive moves the eye to the right
 * @param {number} polar positive moves the eye up
 * @returns {Pose}
 */
export function orbit(pose, azimuth, polar) {
  return { ...pose, eye: add(pose.target, turn(pose, subtract(pose.eye, pose.target), azimuth, polar)) };
}

/**
 * Rotates the view direction about the eye.
 * @param {Pose} pose
 * @param {number} yaw positive turns left
 * @param {number} pitch positive looks up
 * @returns {Pose}
 */
export function look(pose, yaw, pitch) {
  return { ...pose, target: add(pose.eye, turn(pose, subtract(pose.target, pose.eye), yaw, pitch)) };
}

/**
 * Translates eye and target in the image plane, so that the point at the target follows the pointer.
 * @param {Pose} pose
 * @param {number} right fraction of the image height
 * @param {number} up fraction of the image height
 * @returns {Pose}
 */
export function pan(pose, right, up) {
  const axes = basis(pose);
  const height = 2 * distance(pose) * Math.tan((pose.vfov_deg * Math.PI) / 360);
  return shift(pose, add(scale(axes.right, right * height), scale(axes.up, up * height)));
}

/**
 * Moves the eye towards the target.
 * @param {Pose} pose
 * @param {number} factor on the distance; below 1 comes closer
 * @param {number} nearest least distance
 * @returns {Pose}
 */
export function dolly(pose, factor, nearest) {
  const offset = subtract(pose.eye, pose.target);
  const reached = Math.max(nearest, length(offset) * factor);
  return { ...pose, eye: add(pose.target, scale(normalize(offset, [0, 0, 1]), reached)) };
}

/**
 * Flies: eye and target move together along the axes of the camera.
 * @param {Pose} pose
 * @param {Vec3} metres right, up, forward
 * @returns {Pose}
 */
export function fly(pose, metres) {
  const axes = basis(pose);
  return shift(
    pose,
    add(add(scale(axes.right, metres[0]), scale(normalize(pose.up), metres[1])), scale(axes.forward, metres[2])),
  );
}

/**
 * Turns the camera to a point; the eye stays.
 * @param {Pose} pose
 * @param {Vec3} point
 * @returns {Pose}
 */
export function focus(pose, point) {
  return { ...pose, target: point };
}

/**
 * A pose from which a whole sphere is seen.
 * @param {Vec3} center
 * @param {number} radius
 * @param {Pose} [like] whose direction, up and field of view to keep
 * @returns {Pose}
 */
export function frame(center, radius, like) {
  const vfov = like?.vfov_deg ?? 45;
  const up = like ? like.up : /** @type {Vec3} */ ([0, 1, 0]);
  const back = like ? normalize(subtract(like.eye, like.target), [0, 0, 1]) : normalize([0.5, 0.35, 1]);
  const away = Math.max(radius, 1e-9) / Math.sin((Math.min(vfov, 150) * Math.PI) / 360);
  return { eye: add(center, scale(back, away)), target: center, up, vfov_deg: vfov };
}

/**
 * A pose between two.
 * @param {Pose} from
 * @param {Pose} to
 * @param {number} t 0 to 1
 * @returns {Pose}
 */
export function between(from, to, t) {
  if (t >= 1) return to;
  return {
    eye: mix(from.eye, to.eye, t),
    target: mix(from.target, to.target, t),
    up: normalize(mix(normalize(from.up), normalize(to.up), t), to.up),
    vfov_deg: from.vfov_deg + (to.vfov_deg - from.vfov_deg) * t,
  };
}

/**
 * The position of the camera relative to its target in words: "upper front right".
 * In glTF the front of a model faces +Z.
 * @param {Pose} pose
 */
export function spokenDirection(pose) {
  const back = normalize(subtract(pose.eye, pose.target), [0, 0, 1]);
  const words = [];
  if (back[1] > 0.3) words.push('upper');
  if (back[1] < -0.3) words.push('lower');
  if (Math.abs(back[1]) > 0.95) return back[1] > 0 ? 'top' : 'bottom';
  const flat = Math.hypot(back[0], back[2]);
  if (back[2] / flat > 0.38) words.push('front');
  if (back[2] / flat < -0.38) words.push('back');
  if (back[0] / flat > 0.38) words.push('right');
  if (back[0] / flat < -0.38) words.push('left');
  return words.join(' ');
}

/** @param {Pose} pose */
export const distance = (pose) => length(subtract(pose.eye, pose.target));

/** @param {Pose} a @param {Pose} b */
export function samePose(a, b) {
  return (
    a.vfov_deg === b.vfov_deg &&
    [0, 1, 2].every((i) => a.eye[i] === b.eye[i] && a.target[i] === b.target[i] && a.up[i] === b.up[i])
  );
}

/**
 * @param {Pose} pose
 * @param {Vec3} by
 * @returns {Pose}
 */
function shift(pose, by) {
  return { ...pose, eye: add(pose.eye, by), target: add(pose.target, by) };
}
