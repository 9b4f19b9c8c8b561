/**
 * Draws decoded frames on the canvas, at most one per animation frame and the newest only. Requests no animation frame
 * while there is nothing to draw.
 */

/** @typedef {import('./frame-queue.js').DecodedFrame} DecodedFrame */

export class CanvasPresenter {
  /** @type {DecodedFrame | undefined} */
  #next;
  /** @type {number | undefined} */
  #request;
  #context;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {object} options
   * @param {(frame: DecodedFrame) => void} options.shown the frame is on the canvas; its bitmap is closed already
   * @param {() => void} options.dropped a frame was replaced before it was drawn
   */
  constructor(canvas, { shown, dropped }) {
    this.canvas = canvas;
    this.shown = shown;
    this.dropped = dropped;
    this.#context = canvas.getContext('2d', { alpha: false });
  }

  /** @param {DecodedFrame} frame */
  present(frame) {
    if (this.#next) {
      this.#next.bitmap.close();
      this.dropped();
    }
    this.#next = frame;
    this.#request ??= requestAnimationFrame(() => this.#draw());
  }

  /** Clears the canvas, whose image belongs to another scene. */
  clear() {
    this.#next?.bitmap.close();
    this.#next = undefined;
    this.#context?.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  #draw() {
    this.#request = undefined;
    const frame = this.#next;
    this.#next = undefined;
    if (!frame) return;
    const { header, bitmap } = frame;
    const [width, height] = header.fullSize;
    // Setting the size of a canvas clears it, so only on a change.
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    if (this.#context) {
      this.#context.imageSmoothingQuality = 'high';
      // A frame covers the whole canvas at any resolution.
      this.#context.drawImage(bitmap, 0, 0, width, height);
    }
    bitmap.close();
    this.shown(frame);
  }
}
