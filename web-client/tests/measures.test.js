import assert from 'node:assert/strict';
import test from 'node:test';
import { isAtOrAfter, next } from '../src/protocol/serial.js';
import { InputToPhoton } from '../src/view/latency.js';
import { Rate } from '../src/view/rate.js';
import { imageSize } from '../src/view/size.js';
import { missingFeatures } from '../src/view/capabilities.js';

test('sequence numbers compare across the wrap', () => {
  assert.ok(isAtOrAfter(1, 0xffffffff));
  assert.ok(!isAtOrAfter(0xffffffff, 1));
  assert.ok(isAtOrAfter(5, 5));
  assert.equal(next(0xffffffff), 1, 'zero means no input yet');
  assert.equal(next(41), 42);
});

test('latency runs from the input to the first frame that contains it', () => {
  const latency = new InputToPhoton();
  assert.equal(latency.percentiles(), undefined);
  latency.sent(1, 100);
  latency.sent(2, 110);
  latency.sent(3, 120);
  latency.presented(0, 130);
  assert.equal(latency.percentiles(), undefined);
  latency.presented(2, 150);
  latency.presented(2, 500);
  assert.deepEqual(latency.percentiles(), { p50: 40, p95: 50 });
  latency.presented(3, 520);
  assert.deepEqual(latency.percentiles(), { p50: 50, p95: 400 });
});

test('latency counts across the wrap and forgets what was lost', () => {
  const latency = new InputToPhoton();
  latency.sent(0xffffffff, 0);
  latency.sent(1, 10);
  latency.presented(1, 30);
  assert.deepEqual(latency.percentiles(), { p50: 20, p95: 30 });
  latency.sent(2, 40);
  latency.forgetWaiting();
  latency.presented(3, 9999);
  assert.deepEqual(latency.percentiles(), { p50: 20, p95: 30 });
});

test('latency of inputs never answered stays bounded', () => {
  const latency = new InputToPhoton();
  for (let seq = 1; seq <= 10_000; seq += 1) latency.sent(seq, seq);
  latency.presented(10_000, 10_000);
  assert.equal(latency.percentiles().p95 <= 256, true);
});

test('rates cover the last second', () => {
  const rate = new Rate();
  rate.add(0, 100);
  rate.add(500, 50);
  assert.equal(rate.perSecond(999), 150);
  assert.equal(rate.perSecond(1000), 50);
  assert.equal(rate.perSecond(5000), 0);
});

test('the image has device pixels, within the limits and in proportion', () => {
  const limits = { max_side: 4096, max_pixels: 8_300_000 };
  assert.deepEqual(imageSize({ width: 800, height: 600 }, 1, 1, limits), { w: 800, h: 600 });
  assert.deepEqual(imageSize({ width: 390.4, height: 700 }, 3, 1, limits), { w: 1171, h: 2100 });
  assert.deepEqual(imageSize({ width: 800, height: 600 }, 0.5, 1, limits), { w: 800, h: 600 }, 'zoomed out');
  assert.deepEqual(imageSize({ width: 800, height: 600 }, 2, 0.5, limits), { w: 800, h: 600 }, 'half resolution');
  assert.deepEqual(imageSize({ width: 0.2, height: 0 }, 1, 1, limits), { w: 1, h: 1 });
  for (const [width, height] of [[10_000, 10], [3000, 3000], [5120, 2880], [10, 99_999]]) {
    const { w, h } = imageSize({ width, height }, 2, 1, limits);
    assert.ok(Math.max(w, h) <= limits.max_side && w * h <= limits.max_pixels, `${w}x${h}`);
    if (Math.min(w, h) > 100) assert.ok(Math.abs(w / h - width / height) < 0.01);
  }
});

test('missing features have user-visible names', () => {
  assert.ok(missingFeatures({}).some((text) => text.includes('WebSocket')));
  const all = { WebSocket: 1, createImageBitmap: 1, customElements: 1, ResizeObserver: 1, PointerEvent: 1, HTMLCanvasElement: 1 };
  assert.deepEqual(missingFeatures(all), []);
});
