/**
 * Time, timers and random numbers, passed in so that tests control them.
 *
 * @typedef {object} Clock
 * @property {() => number} now monotonic milliseconds
 * @property {(run: () => void, ms: number) => number} setTimeout
 * @property {(id: number) => void} clearTimeout
 * @property {() => number} random in [0, 1)
 */

/** @type {Clock} */
export const browserClock = {
  now: () => performance.now(),
  setTimeout: (run, ms) => window.setTimeout(run, ms),
  clearTimeout: (id) => window.clearTimeout(id),
  random: Math.random,
};
