/**
 * The page against the real server: the first actions of a new user, in order.
 */

import assert from 'node:assert/strict';
import { mkdtemp, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { isDeepStrictEqual } from 'node:util';
import { launch, until } from './support/browser.js';
import { startServer } from './support/real-server.js';
import { cardText, centre } from './support/stage.js';

/** A software device renders slowly, and other work may share the machine. */
const SLOW_MS = 600_000;

/** A scene to test with instead of the demo scenes. */
const SCENE = process.env.SURFELCAST_SCENE ? ['--scene', process.env.SURFELCAST_SCENE] : [];

/** @type {Awaited<ReturnType<typeof startServer>>} */
let server;
/** @type {import('playwright-core').Browser} */
let browser;
/** @type {import('playwright-core').Page} */
let page;
let data = '';
const errors = [];
/** Frames of the WebSockets, by direction and kind. */
const traffic = { frames: 0, bytes: 0, received: [], sent: [] };

before(async () => {
  data = await mkdtemp(join(tmpdir(), 'surfelcast-browser-'));
  server = await startServer({ data, args: SCENE });
  browser = await launch();
  page = await browser.newPage({ viewport: { width: 400, height: 400 }, reducedMotion: 'reduce' });
  page.setDefaultTimeout(SLOW_MS);
  // Events of the view do not bubble, but they are captured on their way down.
  await page.addInitScript(() => {
    window.addEventListener('frame', ({ detail }) => (window.lastFrame = detail), true);
  });
  page.on('pageerror', (error) => errors.push(error.message));
  page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
  page.on('websocket', (socket) => {
    socket.on('framereceived', ({ payload }) => {
      if (typeof payload === 'string') {
        traffic.received.push(payload);
        return;
      }
      traffic.frames += 1;
      traffic.bytes += payload.length;
    });
    socket.on('framesent', ({ payload }) => traffic.sent.push(String(payload)));
  });
});

after(async () => {
  await browser?.close();
  await server?.kill();
  if (data) await rm(data, { recursive: true, force: true });
});

/** Number of the last input sent. */
const lastInput = () =>
  traffic.sent.reduce((last, text) => {
    const { t, seq } = JSON.parse(text);
    return t === 'camera' || t === 'light' ? seq : last;
  }, 0);

/** Waits for a final frame that contains the last input, and until the page says that it has converged. */
async function converged() {
  await until('a final frame with the last input', () => page.evaluate((seq) => {
    const frame = window.lastFrame;
    return frame && frame.inputSeq === seq && (frame.flags & 4) !== 0;
  }, lastInput()), SLOW_MS);
  await page.locator('#hud[data-state=converged]').waitFor({ timeout: SLOW_MS });
}

/** The image as a coarse grid of colours. */
const image = () =>
  page.evaluate(() => {
    const { canvas } = document.querySelector('surfelcast-view');
    const small = new OffscreenCanvas(24, 18);
    const context = small.getContext('2d');
    context.imageSmoothingQuality = 'high';
    context.drawImage(canvas, 0, 0, 24, 18);
    return [...context.getImageData(0, 0, 24, 18).data];
  });

/** Mean difference of two images, 0 to 255. */
const difference = (a, b) => a.reduce((sum, value, i) => sum + Math.abs(value - b[i]), 0) / a.length;

/** Waits for a final image that differs from an earlier one, and until the page says that it has converged. */
async function convergedDifferently(before) {
  await until('a different image', async () => difference(before, await image()) > 2, SLOW_MS);
  await converged();
  assert.ok(difference(before, await image()) > 2, 'the final image shows the change');
}

test('the page loads and the demo scene converges', async () => {
  await page.goto(`${server.address}/?max_spp=16&resolution=0.5`);
  await converged();
  const pixels = await image();
  const mean = pixels.reduce((sum, value) => sum + value, 0) / pixels.length;
  const spread = Math.max(...pixels.filter((_, i) => i % 4 !== 3)) - Math.min(...pixels);
  assert.ok(mean > 70 && spread > 60, `a lit scene, not a blank: mean ${mean}, spread ${spread}`);
  assert.ok((await page.locator('#scene option').count()) >= 1);
  assert.deepEqual(errors, []);
});

test('orbiting changes the image, and it converges again', async () => {
  const before = await image();
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 60, y + 15, { steps: 8 });
  await page.mouse.up();
  await convergedDifferently(before);
});

test('a light edit changes the image, and it converges again', async () => {
  // After the orbit a wall may hide the surfaces that a new light would illuminate.
  const inputs = lastInput();
  await page.locator('surfelcast-view').locator('canvas').focus();
  await page.keyboard.press('Home');
  await until('the camera goes home', () => lastInput() > inputs);
  await converged();
  const before = await image();
  await page.locator('[data-tab=lights]').click();
  await page.getByRole('button', { name: 'Add point light' }).click();
  await convergedDifferently(before);
  await page.locator('[data-tab=lights]').click();
});

test('exposure changes the image', async () => {
  const before = await image();
  await page.locator('[data-tab=view]').click();
  const exposure = page.getByRole('spinbutton', { name: /Exposure/ });
  await exposure.fill(String(Number(await exposure.inputValue()) - 1.5));
  await exposure.press('Enter');
  await convergedDifferently(before);
  await page.locator('[data-tab=view]').click();
});

test('a double click focuses on a surface', async () => {
  const before = traffic.received.length;
  const inputs = lastInput();
  const { x, y } = await centre(page);
  await page.mouse.dblclick(x - 30, y + 20);
  const answer = await until('the answer', () => traffic.received.slice(before).find((text) => text.includes('"picked"')), SLOW_MS);
  assert.equal(JSON.parse(answer).position?.length, 3);
  await until('the camera turns there', () => lastInput() > inputs);
  await converged();
});

test('once converged, traffic stops', async () => {
  await converged();
  /** Messages within `ms` milliseconds, without pings. */
  const during = async (ms) => {
    const { frames, received, sent } = traffic;
    const before = [received.length, sent.length];
    await page.waitForTimeout(ms);
    const texts = [received, sent].flatMap((list, i) => list.slice(before[i])).filter((text) => !/"t":"p[io]ng"/.test(text));
    return [traffic.frames - frames, texts];
  };
  // The last statistics and acknowledgements follow the frame.
  await until('quiet', async () => isDeepStrictEqual(await during(1500), [0, []]));
  assert.deepEqual(await during(5000), [0, []]);
});

test('the page reconnects after the server was killed and restarted', async () => {
  await server.kill();
  await until('the page says so', async () => /Next attempt|Connecting now/.test(await cardText(page)));
  const { frames } = traffic;
  server = await startServer({ data, port: server.port, args: SCENE });
  await until('a new frame', () => traffic.frames > frames, SLOW_MS);
  await converged();
  await until('the message is gone', async () => (await cardText(page)) === '');
});

test('the description of the HTTP interface is served', async () => {
  const docs = await browser.newPage();
  docs.setDefaultTimeout(SLOW_MS);
  await docs.goto(`${server.address}/docs`);
  await docs.getByRole('heading', { name: /POST \/v1\/renders/ }).first().waitFor();
  await docs.close();
});
