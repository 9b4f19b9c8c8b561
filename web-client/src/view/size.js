/**
 * The picture's size to ask for.
 */

/**
 * Device pixels for an area of the page, shrunk in proportion where the server's limits are smaller.
 * @param {{ width: number, height: number }} css CSS pixels
 * @param {number} density device pixels per CSS pixel; at least 1 is used, so that zooming out never blurs
 * @param {number} factor wish of the user for fewer pixels, in (0, 1]
 * @param {{ max_side: number, max_pixels: number }} limits
 * @returns {{ w: number, h: number }} at least 1 each
 */
export function pictureSize(css, density, factor, limits) {
  let w = css.width * Math.max(1, density || 1) * factor;
  let h = css.height * Math.max(1, density || 1) * factor;
  const shrink = Math.min(1, limits.max_side / Math.max(w, h, 1), Math.sqrt(limits.max_pixels / Math.max(w * h, 1)));
  w *= shrink;
  h *= shrink;
  // Rounding down keeps a shrunk picture inside the limits.
  const round = shrink < 1 ? Math.floor : Math.round;
  return { w: Math.max(1, round(w)), h: Math.max(1, round(h)) };
}
