/**
 * From binary message to decoded frame: decodes one at a time, keeps at most one waiting (the newest), acknowledges a
 * frame as soon as it is decoded and passes it on. Never waits for the display.
 */

import { decodeFrame } from '../protocol/frame.js';

/**
 * @typedef {object} DecodedFrame
 * @property {import('../protocol/frame.js').FrameHeader} header
 * @property {ImageBitmap} bitmap
 * @property {number} bytes of the whole message
 */

/** @typedef {{ seq: number, decodeUs: number, dropped: number, queue: number }} Acknowledgement */

export class FrameQueue {
  /** @type {ArrayBuffer | undefined} */
  #waiting;
  #busy = false;
  #dropped = 0;
  /** Number of the connection, so that a frame of an earlier one is not acknowledged to the next. */
  #generation = 0;

  /**
   * @param {object} options
   * @param {(payload: Uint8Array<ArrayBuffer>, mime: string) => Promise<ImageBitmap>} options.decode
   * @param {(ack: Acknowledgement) => void} options.acknowledge
   * @param {(frame: DecodedFrame) => void} options.present takes over the bitmap
   * @param {(error: Error) => void} options.fail
   * @param {() => number} options.now
   */
  constructor(options) {
    this.options = options;
  }

  /** @param {ArrayBuffer} message */
  push(message) {
    if (this.#busy) {
      if (this.#waiting) this.#dropped += 1;
      this.#waiting = message;
      return;
    }
    void this.#run(message, this.#generation);
  }

  /** Counts a decoded frame that a newer one replaced before it was shown. */
  countDropped() {
    this.#dropped += 1;
  }

  /** Drops the waiting frame; for a new connection. */
  reset() {
    this.#generation += 1;
    this.#waiting = undefined;
    this.#dropped = 0;
  }

  /**
   * @param {ArrayBuffer} message
   * @param {number} generation
   */
  async #run(message, generation) {
    this.#busy = true;
    await this.#decode(message, generation);
    this.#busy = false;
    const following = this.#waiting;
    this.#waiting = undefined;
    if (following) void this.#run(following, this.#generation);
  }

  /**
   * @param {ArrayBuffer} message
   * @param {number} generation
   */
  async #decode(message, generation) {
    const { decode, acknowledge, present, fail, now } = this.options;
    let header;
    try {
      const frame = decodeFrame(message);
      header = frame.header;
      const before = now();
      const bitmap = await decode(frame.payload, header.mime);
      if (generation !== this.#generation) {
        bitmap.close();
        return;
      }
      this.#acknowledge(acknowledge, header.frameSeq, Math.round((now() - before) * 1000));
      present({ header, bitmap, bytes: message.byteLength });
    } catch (error) {
      if (generation !== this.#generation) return;
      // An undecodable frame is acknowledged too: the server would wait for it for ever.
      this.#dropped += 1;
      if (header) this.#acknowledge(acknowledge, header.frameSeq, 0);
      fail(/** @type {Error} */ (error));
    }
  }

  /**
   * @param {(ack: Acknowledgement) => void} acknowledge
   * @param {number} seq
   * @param {number} decodeUs
   */
  #acknowledge(acknowledge, seq, decodeUs) {
    acknowledge({ seq, decodeUs, dropped: this.#dropped, queue: this.#waiting ? 1 : 0 });
    this.#dropped = 0;
  }
}
