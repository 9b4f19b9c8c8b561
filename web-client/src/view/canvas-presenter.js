/**
 * Puts pictures on the canvas, at most one an animation frame and the newest only. Asks for no animation frame while
 * there is nothing to show.
 */

/** @typedef {import('./frame-queue.js').Picture} Picture */

export class CanvasPresenter {
  /** @type {Picture | undefined} */
  #next;
  /** @type {number | undefined} */
  #request;
  #context;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} options
   * @param {(picture: Picture) => void} options.shown the picture is on the canvas; its bitmap is closed already
   * @param {() => void} options.dropped a picture was replaced before it was shown
   */
  constructor(canvas, { shown, dropped }) {
    this.canvas = canvas;
    this.shown = shown;
    this.dropped = dropped;
    this.#context = canvas.getContext('2d', { alpha: false });
  }

  /** @param {Picture} picture */
  present(picture) {
    if (this.#next) {
      this.#next.bitmap.close();
      this.dropped();
    }
    this.#next = picture;
    this.#request ??= requestAnimationFrame(() => this.#draw());
  }

  /** Blackens the canvas; what it showed belongs to another scene. */
  clear() {
    this.#next?.bitmap.close();
    this.#next = undefined;
    this.#context?.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  #draw() {
    this.#request = undefined;
    const picture = this.#next;
    this.#next = undefined;
    if (!picture) return;
    const { header, bitmap } = picture;
    const [width, height] = header.fullSize;
    // Setting a canvas' size clears it, so only when it changes.
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (this.#context) {
      this.#context.imageSmoothingQuality = 'high';
      // A full frame covers the picture whatever resolution it was rendered at.
      this.#context.drawImage(bitmap, 0, 0, width, height);
    }
    bitmap.close();
    this.shown(picture);
  }
}
