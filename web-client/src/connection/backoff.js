/**
 * Exponential back-off between attempts: half a second, doubling to thirty, each shortened by up to half at random so
 * that the clients of a restarted server do not all reconnect at the same moment.
 */

export const FIRST_MS = 500;
export const LONGEST_MS = 30_000;

/**
 * Delay before an attempt.
 * @param {number} attempt 0 for the first retry
 * @param {number} random in [0, 1)
 * @param {number} [minimumMs] least delay that the server requested
 */
export function delayMs(attempt, random, minimumMs = 0) {
  const full = Math.min(FIRST_MS * 2 ** Math.min(attempt, 16), LONGEST_MS);
  return Math.max(minimumMs, Math.round(full * (1 - random / 2)), FIRST_MS);
}
