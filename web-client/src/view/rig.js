/**
 * The camera of one view: holds the pose, turns movements into gestures, animates between viewpoints.
 * At rest it sends nothing, so that the image can converge.
 */

import { between, frame, samePose } from './camera.js';
import { browserScheduler, Gesture } from './gesture.js';

/** Duration of the animation to another viewpoint. */
const GLIDE_MS = 350;

/** @typedef {import('../protocol/types.js').Pose} Pose */
/** @typedef {import('../protocol/types.js').NamedPose} NamedPose */

export class Rig {
  /** @type {Pose} */
  pose = { eye: [0, 0, 3], target: [0, 0, 0], up: [0, 1, 0], vfov_deg: 45 };
  /** Radius of the scene, metres: the scale for speeds and nearest distances. */
  radius = 1;
  /** @type {NamedPose[]} */
  presets = [];
  /** @type {Pose} */
  home = this.pose;
  /** @type {Pose} */
  overview = this.pose;
  /** @type {number | undefined} */
  #glide;
  /** @type {Gesture<Pose>} */
  #gesture;

  /**
   * @param {object} options
   * @param {(pose: Pose, phase: import('../protocol/types.js').Phase) => void} options.send
   * @param {(pose: Pose, resting: boolean) => void} options.changed
   * @param {() => boolean} options.reducedMotion
   * @param {import('./gesture.js').Scheduler} [options.scheduler]
   */
  constructor({ send, changed, reducedMotion, scheduler = browserScheduler }) {
    this.scheduler = scheduler;
    this.changed = changed;
    this.reducedMotion = reducedMotion;
    this.#gesture = new Gesture((pose, phase) => {
      send(pose, phase);
      if (phase === 'end') changed(pose, true);
    }, scheduler);
  }

  /**
   * Adopts the viewpoints of a scene and moves to the first.
   * @param {{ cameras: NamedPose[], center: import('../protocol/types.js').Vec3, radius: number }} scene
   */
  enterScene({ cameras, center, radius }) {
    this.#stopGlide();
    this.#gesture.abandon();
    this.radius = radius > 0 ? radius : 1;
    this.presets = cameras;
    this.home = cameras[0]?.pose ?? frame(center, this.radius);
    this.overview = frame(center, this.radius, cameras[0]?.pose);
    this.pose = this.home;
    this.changed(this.pose, true);
  }

  /** Least distance between eye and target of a dolly. */
  get nearest() {
    return this.radius * 1e-3;
  }

  /**
   * Moves as part of a gesture that `end` will close.
   * @param {Pose} pose
   */
  move(pose) {
    this.#stopGlide();
    if (!this.#take(pose)) return;
    this.#gesture.move(pose);
  }

  /**
   * Moves by an input without release (wheel, repeated key); the gesture closes itself.
   * @param {Pose} pose
   */
  burst(pose) {
    this.#stopGlide();
    if (!this.#take(pose)) return;
    this.#gesture.burst(pose);
  }

  /** Closes an open gesture. */
  end() {
    this.#gesture.end();
  }

  /**
   * Animates to a pose; jumps if the user prefers reduced motion.
   * @param {Pose} pose
   */
  goTo(pose) {
    this.#stopGlide();
    if (samePose(pose, this.pose)) return;
    if (this.reducedMotion()) {
      this.#take(pose);
      this.#gesture.once(pose);
      return;
    }
    const from = this.pose;
    const begun = this.scheduler.now();
    const step = () => {
      const t = Math.min(1, (this.scheduler.now() - begun) / GLIDE_MS);
      this.#take(between(from, pose, t * t * (3 - 2 * t)));
      this.#gesture.move(this.pose);
      if (t < 1) this.#glide = this.scheduler.requestFrame(step);
      else {
        this.#glide = undefined;
        this.#gesture.end();
      }
    };
    this.#glide = this.scheduler.requestFrame(step);
  }

  /**
   * Moves to a numbered viewpoint: 1 is the scene's first camera, 0 shows the whole scene.
   * @param {number} number
   */
  goToPreset(number) {
    const pose = number === 0 ? this.overview : this.presets[number - 1]?.pose;
    if (pose) this.goTo(pose);
  }

  /** Drops an open gesture, after the connection was lost. */
  abandon() {
    this.#gesture.abandon();
  }

  /**
   * @param {Pose} pose
   * @returns {boolean} whether it differs from the present one and is finite
   */
  #take(pose) {
    if (samePose(pose, this.pose) || ![...pose.eye, ...pose.target].every(Number.isFinite)) return false;
    this.pose = pose;
    this.changed(pose, false);
    return true;
  }

  #stopGlide() {
    if (this.#glide === undefined) return;
    this.scheduler.cancelFrame(this.#glide);
    this.#glide = undefined;
  }
}
