import assert from 'node:assert/strict';
import test from 'node:test';
import { centre, hasConverged, onStage, until, withBrowser } from './support/stage.js';
import { colorAt } from './support/browser.js';

withBrowser();

/** Camera messages after the page's own first one. */
const cameras = (server) => server.received('camera').slice(1);

function assertGesture(messages) {
  assert.ok(messages.length >= 2, `${messages.length} camera messages`);
  const phases = messages.map(({ phase }) => phase);
  assert.equal(phases[0], 'start');
  assert.equal(phases.at(-1), 'end');
  assert.ok(phases.slice(1, -1).every((phase) => phase === 'move'), phases.join(' '));
  for (let i = 1; i < messages.length; i += 1) assert.equal(messages[i].seq, messages[i - 1].seq + 1);
}

const eyeDistance = ({ eye, target }) => Math.hypot(eye[0] - target[0], eye[1] - target[1], eye[2] - target[2]);

async function drag(page, { dx, dy, button = 'left', keys = [], steps = 12 }) {
  const { x, y } = await centre(page);
  for (const key of keys) await page.keyboard.down(key);
  await page.mouse.move(x, y);
  await page.mouse.down({ button });
  await page.mouse.move(x + dx, y + dy, { steps });
  await page.mouse.up({ button });
  for (const key of keys) await page.keyboard.up(key);
}

const ended = (server, count = 1) =>
  until('the gesture ends', () => cameras(server).filter(({ phase }) => phase === 'end').length >= count);

test('a left drag orbits, the image follows, and converges again at rest', onStage(async ({ page, server }) => {
  const before = await colorAt(page, 0.5, 0.3);
  await drag(page, { dx: 120, dy: 40 });
  await ended(server);
  const messages = cameras(server);
  assertGesture(messages);
  const { pose } = messages.at(-1);
  assert.ok(pose.eye[0] < -0.5, 'dragging right moves the eye left');
  assert.ok(pose.eye[1] > 1.1, 'dragging down raises the eye');
  assert.ok(Math.abs(eyeDistance(pose) - 3.5) < 1e-9);
  const ring = await page.evaluate(() => getComputedStyle(document.querySelector('surfelcast-view').canvas).outlineStyle);
  assert.equal(ring, 'none', 'the focus ring is for the keyboard');
  await page.keyboard.press('ArrowLeft');
  await ended(server, 2);
  await until('the image changes', async () => {
    const after = await colorAt(page, 0.5, 0.3);
    return Math.abs(after[0] - before[0]) > 10;
  });
  await hasConverged(page);
}));

test('Alt + left orbits too; right, middle and modified left drags pan', onStage(async ({ page, server }) => {
  await drag(page, { dx: 60, dy: 0, keys: ['Alt'] });
  await ended(server, 1);
  assert.ok(Math.abs(cameras(server).at(-1).pose.target[0]) < 1e-9, 'orbiting keeps the target');
  let count = 1;
  for (const input of [{ button: 'right' }, { button: 'middle' }, { keys: ['Shift'] }, { keys: ['Control'] }]) {
    const before = cameras(server).at(-1).pose.target;
    await drag(page, { dx: 60, dy: 0, ...input });
    count += 1;
    await ended(server, count);
    const after = cameras(server).at(-1).pose.target;
    assert.ok(Math.hypot(after[0] - before[0], after[2] - before[2]) > 0.05, JSON.stringify(input));
  }
}));

test('the wheel dollies as one gesture whose deltas add up', onStage(async ({ page, server }) => {
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  // Without waiting for each: a pause between two ends the gesture.
  await Promise.all(Array.from({ length: 5 }, () => page.mouse.wheel(0, -100)));
  await ended(server);
  const messages = cameras(server);
  assertGesture(messages);
  assert.ok(Math.abs(eyeDistance(messages.at(-1).pose) - 3.5 * Math.exp(-0.5)) < 1e-6);
}));

test('a double click focuses on the surface', onStage(async ({ page, server }) => {
  const { box } = await centre(page);
  await page.mouse.dblclick(box.x + box.width / 4, box.y + box.height / 2);
  await ended(server);
  const [pick] = server.received('pick');
  assert.ok(Math.abs(pick.x - 0.25) < 0.01 && Math.abs(pick.y - 0.5) < 0.01);
  assert.deepEqual(cameras(server).at(-1).pose.target, [0.25, 0.5, -0.1]);
}));

test('clicking without moving sends nothing', onStage(async ({ page, server }) => {
  const { x, y } = await centre(page);
  await page.mouse.click(x, y);
  await page.waitForTimeout(400);
  assert.equal(cameras(server).length, 0);
}));

test('the keyboard orbits, pans, dollies and goes to viewpoints', onStage(async ({ page, server }) => {
  const canvas = page.locator('surfelcast-view').locator('canvas');
  await canvas.focus();
  let count = 0;
  const press = async (key) => {
    await page.keyboard.press(key);
    count += 1;
    await ended(server, count);
    return cameras(server).at(-1).pose;
  };
  assert.ok((await press('ArrowRight')).eye[0] > 0.1);
  assert.ok((await press('ArrowUp')).eye[1] > 1.1);
  assert.ok(eyeDistance(await press('+')) < 3.49);
  assert.ok(eyeDistance(await press('-')) > 3.4);
  assert.ok((await press('Shift+ArrowLeft')).target[0] < -0.01);
  assert.deepEqual((await press('2')).eye, [2, 1.6, 2.6]);
  assert.match(await canvas.getAttribute('aria-label'), /Cornell box, seen from front right/);
  assert.deepEqual((await press('Home')).eye, [0, 1, 3.5]);
  assert.ok(eyeDistance(await press('0')) > 4);
}));

test('F flies with the keys, and stops when they are released', onStage(async ({ page, server }) => {
  await page.locator('surfelcast-view').locator('canvas').focus();
  await page.keyboard.press('f');
  await page.locator('surfelcast-view').getByText('Flying').waitFor();
  await page.keyboard.down('w');
  await until('it flies', () => cameras(server).at(-1)?.pose.eye[2] < 3.4);
  await page.keyboard.up('w');
  await ended(server);
  const messages = cameras(server);
  assertGesture(messages);
  assert.ok(Math.abs(eyeDistance(messages.at(-1).pose) - 3.5) < 1e-9);
  await page.keyboard.press('f');
  await page.locator('surfelcast-view').getByText('Flying').waitFor({ state: 'hidden' });
  await page.waitForTimeout(300);
  assert.equal(cameras(server).length, messages.length, 'at rest nothing is sent');
}));

test('holding the right button and W flies', onStage(async ({ page, server }) => {
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  await page.mouse.down({ button: 'right' });
  await page.keyboard.down('w');
  await until('it flies', () => cameras(server).at(-1)?.pose.eye[2] < 3.45);
  await page.keyboard.up('w');
  await page.mouse.up({ button: 'right' });
  await ended(server);
}));

test('fingers: one orbits, two pinch and pan, a double tap focuses', onStage(
  async ({ page, server, context }) => {
    const cdp = await context.newCDPSession(page);
    const { x, y } = await centre(page);
    // Timestamps of touches are set, so that the speed of the browser does not matter.
    let timestamp = Date.now() / 1000;
    const touch = (type, ...points) => {
      timestamp += 0.05;
      return cdp.send('Input.dispatchTouchEvent', { type, timestamp, touchPoints: points.map(([px, py], id) => ({ x: px, y: py, id })) });
    };
    await touch('touchStart', [x, y]);
    for (let i = 1; i <= 5; i += 1) await touch('touchMove', [x + 12 * i, y]);
    await touch('touchEnd');
    await ended(server, 1);
    assertGesture(cameras(server));
    assert.ok(Math.abs(cameras(server).at(-1).pose.eye[0]) > 0.3);

    await touch('touchStart', [x - 40, y], [x + 40, y]);
    for (let i = 1; i <= 5; i += 1) await touch('touchMove', [x - 40 - 8 * i, y], [x + 40 + 8 * i, y]);
    await touch('touchEnd');
    await ended(server, 2);
    assert.ok(Math.abs(eyeDistance(cameras(server).at(-1).pose) - 1.75) < 0.02, 'twice as far apart, half the distance');

    for (let i = 0; i < 2; i += 1) {
      await touch('touchStart', [x, y]);
      await touch('touchEnd');
    }
    await until('a pick', () => server.received('pick').length === 1);
  },
  { context: { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true } },
));

test('resizing requests the new size, at most ten times per second', onStage(async ({ page, server }) => {
  // Counted at the sender: arrivals may bunch up on a busy machine.
  await page.evaluate(() => {
    window.sizesSentAt = [];
    const { send } = WebSocket.prototype;
    WebSocket.prototype.send = function (text) {
      if (JSON.parse(text).w) window.sizesSentAt.push(performance.now());
      send.call(this, text);
    };
  });
  for (let width = 1000; width > 860; width -= 10) await page.setViewportSize({ width, height: 700 });
  const { box } = await centre(page);
  await until('the last size', () => server.received('view.set').at(-1).w === Math.round(box.width));
  const times = await page.evaluate(() => window.sizesSentAt);
  assert.ok(times.length >= 1);
  for (let i = 1; i < times.length; i += 1) assert.ok(times[i] - times[i - 1] >= 95, `${times[i] - times[i - 1]} ms apart`);
  await until('the canvas follows', () => page.evaluate((w) => document.querySelector('surfelcast-view').canvas.width === w, Math.round(box.width)));
}));

test('a hidden tab pauses, and showing it resumes', onStage(async ({ page, server }) => {
  const setHidden = (hidden) =>
    page.evaluate((value) => {
      Object.defineProperty(document, 'hidden', { configurable: true, get: () => value });
      document.dispatchEvent(new Event('visibilitychange'));
    }, hidden);
  await setHidden(true);
  await until('pause', () => server.received('view.set').at(-1).paused === true);
  await setHidden(false);
  await until('resume', () => server.received('view.set').at(-1).paused === false);
}));
