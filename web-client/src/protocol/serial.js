/**
 * Serial-number arithmetic over 32 bits: sequence numbers wrap, so they are compared by their distance.
 */

/**
 * Whether `a` is `b` or comes after it.
 * @param {number} a
 * @param {number} b
 */
export function isAtOrAfter(a, b) {
  return ((a - b) | 0) >= 0;
}

/**
 * The number that follows `a`; zero is reserved for "no input yet".
 * @param {number} a
 */
export function next(a) {
  const following = (a + 1) >>> 0;
  return following === 0 ? 1 : following;
}
