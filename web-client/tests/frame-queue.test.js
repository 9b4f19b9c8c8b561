import assert from 'node:assert/strict';
import test from 'node:test';
import { FrameQueue } from '../src/view/frame-queue.js';
import { bytes, frames } from './support/fixtures.js';

const golden = bytes(`${frames()[0]}.bin`);

function message(seq) {
  const copy = golden.slice(0);
  new DataView(copy).setUint32(8, seq, true);
  return copy;
}

function setUp() {
  const acks = [];
  const shown = [];
  const failures = [];
  const decodes = [];
  let time = 0;
  const queue = new FrameQueue({
    decode: () =>
      new Promise((resolve, reject) => {
        const bitmap = { closed: false, close: () => (bitmap.closed = true) };
        decodes.push({ finish: () => resolve(bitmap), fail: () => reject(new Error('bad image')), bitmap });
      }),
    acknowledge: (ack) => acks.push(ack),
    present: ({ header }) => shown.push(header.frameSeq),
    fail: (error) => failures.push(error.message),
    now: () => time,
  });
  const settle = () => new Promise((resolve) => setImmediate(resolve));
  return { queue, acks, shown, failures, decodes, settle, wait: (ms) => (time += ms) };
}

test('acknowledges as soon as a frame is decoded, with the time it took', async () => {
  const { queue, acks, shown, decodes, settle, wait } = setUp();
  queue.push(message(1));
  await settle();
  assert.deepEqual(acks, []);
  wait(3);
  decodes[0].finish();
  await settle();
  assert.deepEqual(acks, [{ seq: 1, decodeUs: 3000, dropped: 0, queue: 0 }]);
  assert.deepEqual(shown, [1]);
});

test('keeps one frame waiting, the newest, and counts the others as dropped', async () => {
  const { queue, acks, shown, decodes, settle } = setUp();
  for (const seq of [1, 2, 3, 4]) queue.push(message(seq));
  decodes[0].finish();
  await settle();
  assert.equal(decodes.length, 2);
  decodes[1].finish();
  await settle();
  assert.deepEqual(shown, [1, 4]);
  assert.deepEqual(acks.map(({ seq, dropped, queue: waiting }) => [seq, dropped, waiting]), [[1, 2, 1], [4, 0, 0]]);
});

test('a frame that cannot be decoded is acknowledged too, and the next one is shown', async () => {
  const { queue, acks, shown, failures, decodes, settle } = setUp();
  queue.push(message(1));
  queue.push(message(2));
  decodes[0].fail();
  await settle();
  decodes[1].finish();
  await settle();
  assert.deepEqual(failures, ['bad image']);
  assert.deepEqual(acks.map(({ seq, dropped }) => [seq, dropped]), [[1, 1], [2, 0]]);
  assert.deepEqual(shown, [2]);
});

test('a message that is no frame is reported and does not block', async () => {
  const { queue, acks, shown, failures, decodes, settle } = setUp();
  queue.push(new ArrayBuffer(3));
  await settle();
  assert.match(failures[0], /shorter/);
  queue.push(message(5));
  decodes[0].finish();
  await settle();
  assert.deepEqual(shown, [5]);
  assert.deepEqual(acks.map(({ seq }) => seq), [5]);
});

test('a new connection receives nothing of the old one, and the old bitmap is closed', async () => {
  const { queue, acks, shown, decodes, settle } = setUp();
  queue.push(message(8));
  queue.push(message(9));
  queue.reset();
  decodes[0].finish();
  await settle();
  assert.deepEqual([acks, shown], [[], []]);
  assert.equal(decodes[0].bitmap.closed, true);
  queue.push(message(1));
  decodes[1].finish();
  await settle();
  assert.deepEqual(acks.map(({ seq, dropped }) => [seq, dropped]), [[1, 0]]);
});
