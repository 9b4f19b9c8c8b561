/**
 * A gesture is `start`, any number of `move`s, `end`. Moves are merged to one an animation frame, the newest winning;
 * `start` and `end` are sent at once and never lost.
 */

/** Least time between two moves; a faster display would exceed the server's limit on inputs. */
const LEAST_INTERVAL_MS = 8;
/** Wheels and repeated keys have no release: their gesture ends after this time without input. */
export const QUIET_MS = 200;

/**
 * @typedef {object} Scheduler
 * @property {(run: () => void) => number} requestFrame
 * @property {(id: number) => void} cancelFrame
 * @property {() => number} now
 * @property {(run: () => void, ms: number) => number} setTimeout
 * @property {(id: number) => void} clearTimeout
 */

/** @type {Scheduler} */
export const browserScheduler = {
  requestFrame: (run) => requestAnimationFrame(() => run()),
  cancelFrame: (id) => cancelAnimationFrame(id),
  now: () => performance.now(),
  setTimeout: (run, ms) => window.setTimeout(run, ms),
  clearTimeout: (id) => window.clearTimeout(id),
};

/** @template T */
export class Gesture {
  /** @type {{ value: T } | undefined} */
  #pending;
  /** @type {number | undefined} */
  #frame;
  /** @type {number | undefined} */
  #quiet;
  #sentAt = -Infinity;
  #open = false;
  /** @type {T | undefined} */
  #newest;

  /**
   * @param {(value: T, phase: import('../protocol/types.js').Phase) => void} send
   * @param {Scheduler} [scheduler]
   */
  constructor(send, scheduler = browserScheduler) {
    this.send = send;
    this.scheduler = scheduler;
  }

  /** Whether a gesture is open. */
  get isOpen() {
    return this.#open;
  }

  /**
   * A new value; opens the gesture if none is open.
   * @param {T} value
   */
  move(value) {
    this.#newest = value;
    this.#clearQuiet();
    if (!this.#open) {
      this.#open = true;
      this.#sentAt = this.scheduler.now();
      this.send(value, 'start');
      return;
    }
    this.#pending = { value };
    this.#frame ??= this.scheduler.requestFrame(() => this.#flush());
  }

  /**
   * A new value from an input without release.
   * @param {T} value
   */
  burst(value) {
    this.move(value);
    this.#quiet = this.scheduler.setTimeout(() => this.end(), QUIET_MS);
  }

  /** Closes the gesture with its newest value; does nothing if none is open. */
  end() {
    this.#clearQuiet();
    this.#dropPending();
    if (!this.#open) return;
    this.#open = false;
    this.send(/** @type {T} */ (this.#newest), 'end');
  }

  /**
   * Sends a value that is a whole gesture.
   * @param {T} value
   */
  once(value) {
    this.#clearQuiet();
    this.#dropPending();
    this.#newest = value;
    this.#open = false;
    this.send(value, 'end');
  }

  /** Drops an open gesture without sending, after the connection was lost. */
  abandon() {
    this.#clearQuiet();
    this.#dropPending();
    this.#open = false;
  }

  #flush() {
    this.#frame = undefined;
    if (!this.#pending) return;
    const now = this.scheduler.now();
    if (now - this.#sentAt < LEAST_INTERVAL_MS) {
      this.#frame = this.scheduler.requestFrame(() => this.#flush());
      return;
    }
    const { value } = this.#pending;
    this.#pending = undefined;
    this.#sentAt = now;
    this.send(value, 'move');
  }

  #dropPending() {
    this.#pending = undefined;
    if (this.#frame !== undefined) this.scheduler.cancelFrame(this.#frame);
    this.#frame = undefined;
  }

  #clearQuiet() {
    if (this.#quiet !== undefined) this.scheduler.clearTimeout(this.#quiet);
    this.#quiet = undefined;
  }
}
