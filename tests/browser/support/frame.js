/**
 * Encodes binary frames as `protocol/src/frame.rs` does.
 */

const CODECS = { jpeg: 1, webp: 2, png: 4 };

/** Bits of the header's flags. */
export const FLAGS = { KEYFRAME: 1, STILL: 2, FINAL: 4, LOSSLESS: 16 };

/**
 * @param {object} frame
 * @param {Buffer} frame.payload
 * @param {'jpeg' | 'webp' | 'png'} [frame.codec]
 * @param {number} frame.frameSeq
 * @param {number} frame.inputSeq
 * @param {[number, number]} frame.size of the payload
 * @param {[number, number]} [frame.fullSize]
 * @param {number} [frame.flags]
 * @param {number} [frame.samples]
 */
export function encodeFrame({ payload, codec = 'png', frameSeq, inputSeq, size, fullSize = size, flags = 1, samples = 1 }) {
  const header = Buffer.alloc(48);
  header.set([0xb7, 1, 1, CODECS[codec]]);
  header.writeUInt16LE(flags, 4);
  header.writeUInt32LE(frameSeq >>> 0, 8);
  header.writeUInt32LE(inputSeq >>> 0, 12);
  header.writeUInt32LE(1, 16);
  [0, 0, ...size, ...fullSize].forEach((value, i) => header.writeUInt16LE(value, 20 + 2 * i));
  header.writeUInt32LE(Math.round(performance.now() * 1000) >>> 0, 32);
  header.writeUInt16LE(820, 36);
  header.writeUInt16LE(140, 38);
  header.writeUInt16LE(Math.min(samples, 65535), 40);
  header[42] = flags & FLAGS.STILL ? 95 : 60;
  header.writeUInt32LE(payload.length, 44);
  return Buffer.concat([header, payload]);
}
