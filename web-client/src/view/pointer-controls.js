/**
 * Mouse, pen and touch. Left drag or one finger orbits; right, middle, Ctrl, Shift or two fingers pan; wheel and pinch
 * dolly; double click or double tap picks the surface, unless a single one is used by a mode. Follows three.js
 * OrbitControls and DCC tools (Alt + left orbits).
 */

import { dolly, look, orbit, pan } from './camera.js';

/** A drag over the height of the image is a full turn. */
const TURN = 2 * Math.PI;
/** Rotation of the view direction is slower than orbiting. */
const LOOK_TURN = 0.6 * Math.PI;
/** Wheel: one notch is about 100 pixels. */
const WHEEL_RATE = 0.001;
/** Browsers report a touchpad pinch as Ctrl + wheel with small deltas. */
const PINCH_WHEEL_RATE = 0.01;
const TAP_MS = 300;
const TAP_PX = 6;
const DOUBLE_TAP_MS = 400;
const DOUBLE_TAP_PX = 24;

/** @typedef {{ x: number, y: number }} Point */
/** @typedef {'orbit' | 'pan'} Drag */

export class PointerControls {
  /** @type {Map<number, Point>} */
  #down = new Map();
  /** @type {Drag} */
  #drag = 'orbit';
  /** @type {{ at: number, x: number, y: number } | undefined} */
  #pressed;
  /** @type {{ at: number, x: number, y: number } | undefined} */
  #tapped;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} options
   * @param {import('./rig.js').Rig} options.rig
   * @param {import('./flight.js').Flight} options.flight
   * @param {(x: number, y: number) => boolean} options.tap at CSS pixels of the canvas; returns
   *   whether the tap was used
   * @param {(x: number, y: number) => void} options.pick the same for a double tap
   * @param {AbortSignal} options.signal ends all listening
   */
  constructor(canvas, { rig, flight, tap, pick, signal }) {
    this.canvas = canvas;
    this.rig = rig;
    this.flight = flight;
    this.tap = tap;
    this.pick = pick;
    canvas.addEventListener('pointerdown', (event) => this.#onDown(event), { signal });
    canvas.addEventListener('pointermove', (event) => this.#onMove(event), { signal });
    canvas.addEventListener('pointerup', (event) => this.#onUp(event, true), { signal });
    canvas.addEventListener('pointercancel', (event) => this.#onUp(event, false), { signal });
    canvas.addEventListener('lostpointercapture', (event) => this.#onUp(event, false), { signal });
    canvas.addEventListener('wheel', (event) => this.#onWheel(event), { signal, passive: false });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault(), { signal });
  }

  /** @param {PointerEvent} event */
  #onDown(event) {
    // The middle button would start the browser's scrolling; the others focus the canvas by default, without a ring.
    if (event.button === 1) {
      event.preventDefault();
      this.canvas.focus({ preventScroll: true });
    }
    this.canvas.setPointerCapture(event.pointerId);
    this.#down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (event.pointerType === 'touch') {
      this.#drag = 'orbit';
    } else {
      const modified = (event.ctrlKey || event.metaKey || event.shiftKey) && !event.altKey;
      this.#drag = event.button === 0 && !modified ? 'orbit' : 'pan';
      this.flight.setButton(event.button === 2);
    }
    this.#pressed =
      this.#down.size === 1 && event.button === 0
        ? { at: event.timeStamp, x: event.clientX, y: event.clientY }
        : undefined;
  }

  /** @param {PointerEvent} event */
  #onMove(event) {
    if (document.pointerLockElement && this.flight.mode) {
      // A locked pointer has no release, so the gesture ends after a quiet time.
      this.rig.burst(this.#looked(event.movementX, event.movementY));
      return;
    }
    const before = this.#down.get(event.pointerId);
    if (!before) return;
    const after = { x: event.clientX, y: event.clientY };
    if (this.#down.size === 2) this.#movePinch(event.pointerId, before, after);
    else if (this.#down.size === 1) this.#moveOne(after.x - before.x, after.y - before.y);
    this.#down.set(event.pointerId, after);
  }

  /**
   * @param {number} dx CSS pixels
   * @param {number} dy CSS pixels
   */
  #moveOne(dx, dy) {
    const height = this.canvas.clientHeight || 1;
    if (this.flight.looking) this.rig.move(this.#looked(dx, dy));
    else if (this.#drag === 'pan') this.rig.move(pan(this.rig.pose, -dx / height, dy / height));
    else this.rig.move(orbit(this.rig.pose, (-TURN * dx) / height, (TURN * dy) / height));
  }

  /**
   * @param {number} dx
   * @param {number} dy
   */
  #looked(dx, dy) {
    const height = this.canvas.clientHeight || 1;
    return look(this.rig.pose, (-LOOK_TURN * dx) / height, (-LOOK_TURN * dy) / height);
  }

  /**
   * Two fingers: their midpoint pans, their distance dollies.
   * @param {number} moving
   * @param {Point} before
   * @param {Point} after
   */
  #movePinch(moving, before, after) {
    let other = before;
    for (const [id, point] of this.#down) if (id !== moving) other = point;
    const height = this.canvas.clientHeight || 1;
    const spread = Math.hypot(before.x - other.x, before.y - other.y);
    const spreadAfter = Math.hypot(after.x - other.x, after.y - other.y);
    const factor = spread > 0 && spreadAfter > 0 ? spread / spreadAfter : 1;
    const panned = pan(this.rig.pose, (before.x - after.x) / 2 / height, (after.y - before.y) / 2 / height);
    this.rig.move(dolly(panned, factor, this.rig.nearest));
  }

  /**
   * @param {PointerEvent} event
   * @param {boolean} released by the user, not cancelled by the browser
   */
  #onUp(event, released) {
    if (!this.#down.delete(event.pointerId)) return;
    if (event.pointerType !== 'touch') this.flight.setButton(false);
    if (this.#down.size > 0) return;
    this.rig.end();
    if (released) this.#noteTap(event);
    this.#pressed = undefined;
  }

  /** @param {PointerEvent} event */
  #noteTap(event) {
    const pressed = this.#pressed;
    if (!pressed || event.timeStamp - pressed.at > TAP_MS) return;
    if (Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) > TAP_PX) return;
    const box = this.canvas.getBoundingClientRect();
    const before = this.#tapped;
    const tap = { at: event.timeStamp, x: event.clientX, y: event.clientY };
    if (this.tap(tap.x - box.left, tap.y - box.top)) {
      this.#tapped = undefined;
    } else if (before && tap.at - before.at < DOUBLE_TAP_MS && Math.hypot(tap.x - before.x, tap.y - before.y) < DOUBLE_TAP_PX) {
      this.#tapped = undefined;
      this.pick(tap.x - box.left, tap.y - box.top);
    } else {
      this.#tapped = tap;
    }
  }

  /** @param {WheelEvent} event */
  #onWheel(event) {
    event.preventDefault();
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : event.deltaMode === WheelEvent.DOM_DELTA_PAGE ? 400 : 1;
    const amount = event.deltaY * unit * (event.ctrlKey ? PINCH_WHEEL_RATE : WHEEL_RATE);
    if (amount === 0) return;
    if (this.flight.mode) this.flight.changeSpeed(Math.exp(-amount));
    else this.rig.burst(dolly(this.rig.pose, Math.exp(amount), this.rig.nearest));
  }
}
