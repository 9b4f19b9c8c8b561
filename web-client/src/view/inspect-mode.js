/**
 * Looking into the renderer: while the mode is on, a click asks which surfels light the surface under it. One question
 * at a time; of the points clicked meanwhile the newest is asked next.
 */

/** @typedef {{ x: number, y: number }} Point fractions of the picture, from its upper left corner */

export class InspectMode {
  #on = false;
  /** Id of the question that is out. @type {number | undefined} */
  #asked;
  /** Point to ask about next. @type {Point | undefined} */
  #next;

  /**
   * @param {object} options
   * @param {(point: Point) => number | undefined} options.send sends the question and returns its id; nothing when nobody hears it
   * @param {(mode: { on: boolean, waiting: boolean }) => void} options.changed
   * @param {(point: Point | undefined) => void} options.mark shows which point is meant
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
    this.#forget();
  }

  /** @param {Point} point */
  ask(point) {
    if (!this.#on) return;
    if (this.#asked !== undefined) {
      this.#next = point;
      this.mark(point);
      return;
    }
    this.#asked = this.send(point);
    if (this.#asked === undefined) return;
    this.mark(point);
    this.#tell();
  }

  /**
   * An answer or a refusal came.
   * @param {number | null | undefined} re id of the question
   * @returns {'other' | 'stale' | 'newest'} whether it is to one of ours, and still of interest
   */
  answered(re) {
    if (re === undefined || re === null || re !== this.#asked) return 'other';
    this.#asked = undefined;
    const next = this.#next;
    this.#next = undefined;
    if (next) this.ask(next);
    if (this.#asked !== undefined) return 'stale';
    this.#tell();
    return 'newest';
  }

  /** The camera moved: the mark would point at something else now. */
  moved() {
    this.mark(undefined);
  }

  /** Nobody will answer any more. */
  lost() {
    if (this.#asked !== undefined) this.#forget();
  }

  #forget() {
    this.#asked = undefined;
    this.#next = undefined;
    this.mark(undefined);
    this.#tell();
  }

  #tell() {
    this.changed({ on: this.#on, waiting: this.#asked !== undefined });
  }
}

/**
 * Marks a point of the picture with an element that lies over it.
 * @param {HTMLElement} element
 * @returns {(point: Point | undefined) => void}
 */
export const marking = (element) => (point) => {
  element.hidden = !point;
  if (!point) return;
  element.style.left = `${100 * point.x}%`;
  element.style.top = `${100 * point.y}%`;
};
