/**
 * Input-to-photon latency: from sending an input to presenting the first frame that contains it.
 */

import { isAtOrAfter } from '../protocol/serial.js';

/** Most inputs that wait for their frame; the oldest are dropped. */
const MOST_WAITING = 256;
/** Samples of which the percentiles are taken. */
const MOST_SAMPLES = 240;

export class InputToPhoton {
  /** @type {{ seq: number, at: number }[]} oldest first */
  #waiting = [];
  /** @type {number[]} */
  #samples = [];

  /**
   * @param {number} seq
   * @param {number} at milliseconds
   */
  sent(seq, at) {
    this.#waiting.push({ seq, at });
    if (this.#waiting.length > MOST_WAITING) this.#waiting.shift();
  }

  /**
   * A frame containing all inputs up to `inputSeq` is on the screen.
   * @param {number} inputSeq
   * @param {number} at milliseconds
   */
  presented(inputSeq, at) {
    while (this.#waiting[0] && isAtOrAfter(inputSeq, this.#waiting[0].seq)) {
      const input = this.#waiting.shift();
      if (input) this.#samples.push(at - input.at);
    }
    if (this.#samples.length > MOST_SAMPLES) this.#samples.splice(0, this.#samples.length - MOST_SAMPLES);
  }

  /** Drops inputs that were sent before the connection was lost: no frame will contain them. */
  forgetWaiting() {
    this.#waiting.length = 0;
  }

  /**
   * Nearest-rank percentiles in milliseconds, or undefined before the first sample.
   * @returns {{ p50: number, p95: number } | undefined}
   */
  percentiles() {
    if (this.#samples.length === 0) return undefined;
    const sorted = this.#samples.toSorted((a, b) => a - b);
    /** @param {number} p */
    const rank = (p) => /** @type {number} */ (sorted[Math.max(0, Math.ceil(p * sorted.length) - 1)]);
    return { p50: rank(0.5), p95: rank(0.95) };
  }
}
