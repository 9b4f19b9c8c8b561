/**
 * Inspection of the renderer: while the mode is on, a click requests what lights the surface under it. One
 * request at a time; of the points clicked meanwhile the newest is requested next.
 */

/** @typedef {{ x: number, y: number }} Point fractions of the image, from its upper left corner */

export class InspectMode {
  #on = false;
  /** Id of the request that is open. @type {number | undefined} */
  #pending;
  /** Point to request next. @type {Point | undefined} */
  #next;

  /**
   * @param {object} options
   * @param {(point: Point) => number | undefined} options.send returns the id of the
   *   request; nothing if it could not be sent
   * @param {(mode: { on: boolean, waiting: boolean }) => void} options.changed
   * @param {(point: Point | undefined) => void} options.mark shows the requested point
   */
  constructor({ send, changed, mark }) {
    this.send = send;
    this.changed = changed;
    this.mark = mark;
  }

  get on() {
    return this.#on;
  }

  /** @param {boolean} on */
  set(on) {
    if (on === this.#on) return;
    this.#on = on;
    this.#reset();
  }

  /** @param {Point} point */
  request(point) {
    if (!this.#on) return;
    if (this.#pending !== undefined) {
      this.#next = point;
      this.mark(point);
      return;
    }
    this.#pending = this.send(point);
    if (this.#pending === undefined) return;
    this.mark(point);
    this.#emit();
  }

  /**
   * An answer or a refusal arrived.
   * @param {number | null | undefined} re id of the request
   * @returns {'other' | 'stale' | 'newest'} whether it answers a request of ours, and no newer one is open
   */
  onAnswer(re) {
    if (re === undefined || re === null || re !== this.#pending) return 'other';
    this.#pending = undefined;
    const next = this.#next;
    this.#next = undefined;
    if (next) this.request(next);
    if (this.#pending !== undefined) return 'stale';
    this.#emit();
    return 'newest';
  }

  /** The mark would point at another surface. */
  onCameraMove() {
    this.mark(undefined);
  }

  /** The open request will not be answered. */
  onDisconnect() {
    if (this.#pending !== undefined) this.#reset();
  }

  #reset() {
    this.#pending = undefined;
    this.#next = undefined;
    this.mark(undefined);
    this.#emit();
  }

  #emit() {
    this.changed({ on: this.#on, waiting: this.#pending !== undefined });
  }
}

/**
 * Marks a point of the image with an element on top of it.
 * @param {HTMLElement} element
 * @returns {(point: Point | undefined) => void}
 */
export const marking = (element) => (point) => {
  element.hidden = !point;
  if (!point) return;
  element.style.left = `${100 * point.x}%`;
  element.style.top = `${100 * point.y}%`;
};
