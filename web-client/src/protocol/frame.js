/**
 * Binary frames: a 48-byte little-endian header, then the encoded image. Mirrors `protocol/src/frame.rs`.
 */

export const MAGIC = 0xb7;
export const HEADER_VERSION = 1;
export const HEADER_BYTES = 48;
export const KIND_FULL = 1;

/** Bits of {@link FrameHeader.flags}. */
export const flags = Object.freeze({ KEYFRAME: 1, STILL: 2, FINAL: 4, LOSSLESS: 16 });

/** MIME type by codec number. */
const CODECS = /** @type {Record<number, { codec: import('./types.js').Codec, mime: string }>} */ ({
  1: { codec: 'jpeg', mime: 'image/jpeg' },
  2: { codec: 'webp', mime: 'image/webp' },
  4: { codec: 'png', mime: 'image/png' },
});

/**
 * @typedef {object} FrameHeader
 * @property {import('./types.js').Codec} codec
 * @property {string} mime MIME type of the payload
 * @property {number} flags see {@link flags}
 * @property {number} view
 * @property {number} frameSeq number of this frame, wraps
 * @property {number} inputSeq last client input contained in the image
 * @property {number} sceneRev
 * @property {[number, number, number, number]} rect x, y, width, height of the payload
 * @property {[number, number]} fullSize width and height of the view
 * @property {number} serverUs server's monotonic microseconds, low 32 bits
 * @property {number} renderMs
 * @property {number} encodeMs
 * @property {number} samples samples per pixel, saturating at 65535
 * @property {number} quality 1 to 100
 * @property {number} payloadBytes
 */

/** Why a binary message is not a frame. */
export class FrameError extends Error {
  name = 'FrameError';
}

/**
 * Decodes a whole message: its header and the encoded image after it.
 * @param {ArrayBuffer} message
 * @returns {{ header: FrameHeader, payload: Uint8Array<ArrayBuffer> }}
 * @throws {FrameError} if the message is not a frame of this version
 */
export function decodeFrame(message) {
  if (message.byteLength < HEADER_BYTES) {
    throw new FrameError(`frame of ${message.byteLength} bytes is shorter than its ${HEADER_BYTES}-byte header`);
  }
  const b = new DataView(message, 0, HEADER_BYTES);
  expect('magic', b.getUint8(0), MAGIC);
  expect('version', b.getUint8(1), HEADER_VERSION);
  expect('kind', b.getUint8(2), KIND_FULL);
  const codec = CODECS[b.getUint8(3)];
  if (!codec) throw new FrameError(`frame codec is ${b.getUint8(3)}, expected 1, 2 or 4`);
  const stated = b.getUint32(44, true);
  const present = message.byteLength - HEADER_BYTES;
  if (stated !== present) {
    throw new FrameError(`frame payload_len is ${stated} but ${present} bytes follow the header`);
  }
  /** @param {number} at */
  const u16 = (at) => b.getUint16(at, true);
  return {
    header: {
      ...codec,
      flags: u16(4),
      view: u16(6),
      frameSeq: b.getUint32(8, true),
      inputSeq: b.getUint32(12, true),
      sceneRev: b.getUint32(16, true),
      rect: [u16(20), u16(22), u16(24), u16(26)],
      fullSize: [u16(28), u16(30)],
      serverUs: b.getUint32(32, true),
      renderMs: u16(36) / 100,
      encodeMs: u16(38) / 100,
      samples: u16(40),
      quality: b.getUint8(42),
      payloadBytes: stated,
    },
    payload: new Uint8Array(message, HEADER_BYTES),
  };
}

/**
 * @param {string} field
 * @param {number} value
 * @param {number} expected
 */
function expect(field, value, expected) {
  if (value !== expected) throw new FrameError(`frame ${field} is ${value}, expected ${expected}`);
}
