import assert from 'node:assert/strict';
import test from 'node:test';
import { decodeFrame, FrameError, flags } from '../src/protocol/frame.js';
import { bytes, frames, json, rust } from './support/fixtures.js';

test('golden frames decode to what the Rust side encoded', () => {
  assert.ok(frames().length >= 3, 'the golden frames are there');
  for (const name of frames()) {
    const golden = json(`${name}.json`);
    const { header, payload } = decodeFrame(bytes(`${name}.bin`));
    assert.deepEqual(
      {
        codec: header.codec,
        flags: header.flags,
        view: header.view,
        frame_seq: header.frameSeq,
        input_seq: header.inputSeq,
        scene_rev: header.sceneRev,
        rect: header.rect,
        full_size: header.fullSize,
        server_us: header.serverUs,
        render_10us: Math.round(header.renderMs * 100),
        encode_10us: Math.round(header.encodeMs * 100),
        spp: header.samples,
        quality: header.quality,
        payload_len: header.payloadBytes,
        payload_hex: Buffer.from(payload).toString('hex'),
      },
      golden,
      name,
    );
    assert.equal(header.mime, `image/${golden.codec}`);
  }
});

test('the bits of the flags are those of the Rust side', () => {
  const source = rust('frame.rs');
  for (const [name, bit] of Object.entries(flags)) {
    assert.match(source, new RegExp(`pub const ${name}: u16 = ${bit};`), name);
  }
});

test('anything else is refused with the field and what was expected', () => {
  const good = bytes(`${frames()[0]}.bin`);
  const spoil = (at, value) => {
    const copy = good.slice(0);
    new Uint8Array(copy)[at] = value;
    return copy;
  };
  const cases = [
    [new ArrayBuffer(0), /0 bytes is shorter/],
    [good.slice(0, 47), /47 bytes is shorter/],
    [spoil(0, 1), /magic is 1, expected 183/],
    [spoil(1, 2), /version is 2, expected 1/],
    [spoil(2, 9), /kind is 9, expected 1/],
    [spoil(3, 3), /codec is 3/],
    [good.slice(0, good.byteLength - 1), /payload_len is \d+ but/],
    [Uint8Array.from([...new Uint8Array(good), 0]).buffer, /payload_len is \d+ but/],
    [spoil(47, 255), /payload_len is \d+ but/],
  ];
  for (const [message, reason] of cases) {
    assert.throws(() => decodeFrame(message), (error) => error instanceof FrameError && reason.test(error.message));
  }
});
