/**
 * Features of this browser, probed before the client uses them.
 */

/** @typedef {import('../protocol/types.js').Codec} Codec */

/**
 * User-visible names of the features that the client needs and this browser lacks.
 * @param {Record<string, unknown>} [scope] global object, for tests
 * @returns {string[]}
 */
export function missingFeatures(scope = /** @type {any} */ (globalThis)) {
  const needed = {
    WebSocket: 'WebSocket connections',
    createImageBitmap: 'image decoding (createImageBitmap)',
    customElements: 'custom elements',
    ResizeObserver: 'size observation (ResizeObserver)',
    PointerEvent: 'pointer input (PointerEvent)',
    HTMLCanvasElement: 'canvas drawing',
  };
  return Object.entries(needed)
    .filter(([name]) => scope[name] === undefined)
    .map(([, label]) => label);
}

/** One white pixel as lossy WebP, the variant that every decoder of the format supports. */
const WEBP_PIXEL = 'UklGRiIAAABXRUJQVlA4IBYAAAAwAQCdASoBAAEADsD+JaQAA3AAAAAA';

/**
 * Codecs this browser decodes, best first.
 * @returns {Promise<Codec[]>}
 */
export async function decodableCodecs() {
  const bytes = Uint8Array.from(atob(WEBP_PIXEL), (character) => character.charCodeAt(0));
  try {
    (await createImageBitmap(new Blob([bytes], { type: 'image/webp' }))).close();
    return ['webp', 'jpeg', 'png'];
  } catch {
    return ['jpeg', 'png'];
  }
}

/** Whether the user prefers reduced motion. */
export const prefersReducedMotion = () => matchMedia('(prefers-reduced-motion: reduce)').matches;
