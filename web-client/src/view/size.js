/**
 * The size of the image to request.
 */

/**
 * Device pixels of an area of the page, scaled down in proportion to fit the server's limits.
 * @param {{ width: number, height: number }} css CSS pixels
 * @param {number} density device pixels per CSS pixel; at least 1 is used, so that zooming out does not blur
 * @param {number} factor chosen by the user, in (0, 1]
 * @param {{ max_side: number, max_pixels: number }} limits
 * @returns {{ w: number, h: number }} at least 1 each
 */
export function imageSize(css, density, factor, limits) {
  let w = css.width * Math.max(1, density || 1) * factor;
  let h = css.height * Math.max(1, density || 1) * factor;
  const shrink = Math.min(1, limits.max_side / Math.max(w, h, 1), Math.sqrt(limits.max_pixels / Math.max(w * h, 1)));
  w *= shrink;
  h *= shrink;
  // Rounding down keeps a scaled image within the limits.
  const round = shrink < 1 ? Math.floor : Math.round;
  return { w: Math.max(1, round(w)), h: Math.max(1, round(h)) };
}
