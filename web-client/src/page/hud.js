/**
 * One line over the lower edge of the image: whether it has converged, its error, the rates. Updated at most four times
 * per second, and once more after the last frame so that the rates fall back to zero.
 */

import { flags } from '../protocol/frame.js';
import { auditedError, bytes, count, milliseconds, resolutionText } from './format.js';

const INTERVAL_MS = 250;
/** Rates cover the last second. */
const LAST_UPDATE_MS = 1050;

export class Hud {
  /** @type {import('../protocol/frame.js').FrameHeader | undefined} */
  #frame;
  /** @type {import('../protocol/types.js').Stats | undefined} */
  #stats;
  #moving = false;
  #live = false;
  /** Whether an input or a lost connection came after the newest frame. */
  #stale = false;
  #frameAt = 0;
  /** @type {number | undefined} */
  #timer;

  /**
   * @param {HTMLElement} element with children `.state`, `.progress`, `.rates`
   * @param {import('../view/surfelcast-view.js').SurfelcastView} view
   * @param {import('./stats-panel.js').StatsPanel} panel shows the same measurements
   */
  constructor(element, view, panel) {
    this.element = element;
    this.view = view;
    this.panel = panel;
    /** @param {string} name */
    const part = (name) => /** @type {HTMLElement} */ (element.querySelector(name));
    this.progress = part('.progress');
    this.rates = part('.rates');
  }

  /** @param {import('../protocol/frame.js').FrameHeader} frame */
  frame(frame) {
    this.#frame = frame;
    this.#stale = false;
    this.#frameAt = performance.now();
    this.#schedule(INTERVAL_MS);
  }

  /** @param {import('../protocol/types.js').Stats} stats */
  stats(stats) {
    this.#stats = stats;
    this.#schedule(INTERVAL_MS);
  }

  /** @param {boolean} moving */
  moving(moving) {
    if (moving === this.#moving) return;
    this.#moving = moving;
    // The statistics belong to the image before the movement.
    if (moving) {
      this.#stats = undefined;
      this.#stale = true;
    }
    this.#render();
  }

  /** @param {boolean} live whether the connection is live */
  live(live) {
    this.#live = live;
    if (!live) this.#stale = true;
    this.#render();
  }

  /** Forgets frame and statistics. */
  clear() {
    this.#frame = undefined;
    this.#stats = undefined;
    this.#render();
  }

  /** @param {number} ms */
  #schedule(ms) {
    this.#timer ??= window.setTimeout(() => {
      this.#timer = undefined;
      this.#render();
    }, ms);
  }

  #render() {
    this.element.hidden = !this.#frame;
    if (!this.#frame) return;
    const measured = this.view.measure();
    // Statistics may arrive before their frame, which has to be decoded first.
    const converged = !this.#moving && !this.#stale && (this.#frame.flags & flags.FINAL) !== 0 && this.#stats?.converged !== false;
    this.element.dataset['state'] = !this.#live ? 'away' : this.#moving ? 'moving' : converged ? 'converged' : 'refining';
    this.progress.textContent = this.#progressText(converged);
    const [width, height] = this.#frame.fullSize;
    const parts = [`${width} × ${height}`];
    if (measured.framesPerSecond > 0) parts.unshift(`${count(measured.framesPerSecond)} fps`, `${bytes(measured.bytesPerSecond)}/s`);
    if (measured.latency) parts.push(`input to photon ${count(measured.latency.p50)} / ${milliseconds(measured.latency.p95)}`);
    this.rates.textContent = parts.join('  ·  ');
    this.panel.measured(measured);
    if (performance.now() - this.#frameAt < LAST_UPDATE_MS) this.#schedule(LAST_UPDATE_MS / 2);
  }

  /** @param {boolean} converged */
  #progressText(converged) {
    if (!this.#live) return 'Last frame';
    if (this.#moving) return ['Moving', this.#stats && resolutionText(this.#stats)].filter(Boolean).join(': ');
    const samples = `${count(Math.max(this.#stats?.samples ?? 0, this.#frame?.samples ?? 0))} samples`;
    const error = this.#stats?.error ? auditedError(this.#stats.error) : samples;
    return `${converged ? 'Converged' : 'Refining'}: ${error}`;
  }
}
