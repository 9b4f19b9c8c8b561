/**
 * Flying with W A S D Q E. Runs an animation loop only while keys are held and flying is on.
 */

import { fly } from './camera.js';

/** Scene radii per second. */
const SPEED = 0.35;
/** Factor while Shift is held. */
const FAST = 4;

/** @type {Record<string, import('../protocol/types.js').Vec3>} right, up, forward by key */
const DIRECTIONS = {
  KeyW: [0, 0, 1],
  KeyS: [0, 0, -1],
  KeyA: [-1, 0, 0],
  KeyD: [1, 0, 0],
  KeyQ: [0, -1, 0],
  KeyE: [0, 1, 0],
};

export class Flight {
  /** Fly mode, toggled by the user. */
  #mode = false;
  /** Whether the right button is held, which flies as well. */
  #button = false;
  #fast = false;
  /** Factor set by the wheel. */
  #speed = 1;
  /** @type {Set<string>} */
  #held = new Set();
  /** @type {number | undefined} */
  #loop;
  #last = 0;

  /**
   * @param {import('./rig.js').Rig} rig
   * @param {(on: boolean) => void} modeChanged
   */
  constructor(rig, modeChanged) {
    this.rig = rig;
    this.modeChanged = modeChanged;
  }

  get mode() {
    return this.#mode;
  }

  /** Whether pointer movement rotates the view direction. */
  get looking() {
    return this.#mode || (this.#button && this.#held.size > 0);
  }

  /** @param {boolean} on */
  setMode(on) {
    if (on === this.#mode) return;
    this.#mode = on;
    if (!on && !this.#button) this.releaseAll();
    this.modeChanged(on);
  }

  /** @param {boolean} down */
  setButton(down) {
    this.#button = down;
    if (!down && !this.#mode) this.releaseAll();
  }

  /** @param {number} factor */
  changeSpeed(factor) {
    this.#speed = Math.min(20, Math.max(0.05, this.#speed * factor));
  }

  /**
   * @param {string} code `KeyboardEvent.code`, so that the keys are at the same place on every layout
   * @param {boolean} fast
   * @returns {boolean} whether the key was used
   */
  press(code, fast) {
    if (!(this.#mode || this.#button) || !Object.hasOwn(DIRECTIONS, code)) return false;
    this.#fast = fast;
    this.#held.add(code);
    if (this.#loop === undefined) {
      this.#last = this.rig.scheduler.now();
      this.#loop = this.rig.scheduler.requestFrame(() => this.#step());
    }
    return true;
  }

  /**
   * @param {string} code
   * @param {boolean} fast
   */
  release(code, fast) {
    this.#fast = fast;
    if (this.#held.delete(code) && this.#held.size === 0) this.releaseAll();
  }

  releaseAll() {
    this.#held.clear();
    if (this.#loop === undefined) return;
    this.rig.scheduler.cancelFrame(this.#loop);
    this.#loop = undefined;
    this.rig.end();
  }

  #step() {
    const now = this.rig.scheduler.now();
    // Bounded, so that a stalled tab does not jump.
    const seconds = Math.min(0.1, (now - this.#last) / 1000);
    this.#last = now;
    const metres = this.rig.radius * SPEED * this.#speed * (this.#fast ? FAST : 1) * seconds;
    /** @type {import('../protocol/types.js').Vec3} */
    const offset = [0, 0, 0];
    for (const code of this.#held) {
      DIRECTIONS[code]?.forEach((part, axis) => {
        offset[axis] = /** @type {number} */ (offset[axis]) + part * metres;
      });
    }
    this.rig.move(fly(this.rig.pose, offset));
    this.#loop = this.rig.scheduler.requestFrame(() => this.#step());
  }
}
