/**
 * The page against the real server: what a new user would do first, in order.
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

/** Another scene than the demo may be named, to see how the page fares with it. */
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
const traffic = { pictures: 0, bytes: 0, received: [], sent: [] };

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
      traffic.pictures += 1;
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

/** Waits until the picture contains the last input and is one after which nothing follows, and the page says so. */
async function settled() {
  await until('a final picture with the last input', () => page.evaluate((seq) => {
    const frame = window.lastFrame;
    return frame && frame.inputSeq === seq && (frame.flags & 4) !== 0;
  }, lastInput()), SLOW_MS);
  await page.locator('#hud[data-state=settled]').waitFor({ timeout: SLOW_MS });
}

/** The picture as a coarse grid of brightness and colour. */
const picture = () =>
  page.evaluate(() => {
    const { canvas } = document.querySelector('surfelcast-view');
    const small = new OffscreenCanvas(24, 18);
    const context = small.getContext('2d');
    context.imageSmoothingQuality = 'high';
    context.drawImage(canvas, 0, 0, 24, 18);
    return [...context.getImageData(0, 0, 24, 18).data];
  });

/** Mean difference of two pictures, 0 to 255. */
const difference = (a, b) => a.reduce((sum, value, i) => sum + Math.abs(value - b[i]), 0) / a.length;

/** Waits for a final picture that differs from an earlier one, and for the page to say that it has settled. */
async function settledDifferently(before) {
  await until('a different picture', async () => difference(before, await picture()) > 2, SLOW_MS);
  await settled();
  assert.ok(difference(before, await picture()) > 2, 'the final picture shows the change');
}

test('the page loads and the demo scene settles', async () => {
  await page.goto(`${server.address}/?max_spp=16&resolution=0.5`);
  await settled();
  const pixels = await picture();
  const mean = pixels.reduce((sum, value) => sum + value, 0) / pixels.length;
  const spread = Math.max(...pixels.filter((_, i) => i % 4 !== 3)) - Math.min(...pixels);
  assert.ok(mean > 70 && spread > 60, `a lit scene, not a blank: mean ${mean}, spread ${spread}`);
  assert.ok((await page.locator('#scene option').count()) >= 1);
  assert.deepEqual(errors, []);
});

test('orbiting changes the picture, and it settles again', async () => {
  const before = await picture();
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 60, y + 15, { steps: 8 });
  await page.mouse.up();
  await settledDifferently(before);
});

test('a light edit changes the picture, and it settles again', async () => {
  // The orbit may have led behind a wall, where a new light would shine on nothing that is seen.
  const inputs = lastInput();
  await page.locator('surfelcast-view').locator('canvas').focus();
  await page.keyboard.press('Home');
  await until('the camera goes home', () => lastInput() > inputs);
  await settled();
  const before = await picture();
  await page.locator('[data-tab=lights]').click();
  await page.getByRole('button', { name: 'Add point light' }).click();
  await settledDifferently(before);
  await page.locator('[data-tab=lights]').click();
});

test('exposure changes the picture', async () => {
  const before = await picture();
  await page.locator('[data-tab=view]').click();
  const exposure = page.getByRole('spinbutton', { name: /Exposure/ });
  await exposure.fill(String(Number(await exposure.inputValue()) - 1.5));
  await exposure.press('Enter');
  await settledDifferently(before);
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
  await settled();
});

test('once settled, traffic stops', async () => {
  await settled();
  /** What goes over the wire in so many milliseconds, but for signs of life. */
  const during = async (ms) => {
    const { pictures, received, sent } = traffic;
    const before = [received.length, sent.length];
    await page.waitForTimeout(ms);
    const texts = [received, sent].flatMap((list, i) => list.slice(before[i])).filter((text) => !/"t":"p[io]ng"/.test(text));
    return [traffic.pictures - pictures, texts];
  };
  // The last figures and acknowledgements come after the picture.
  await until('quiet', async () => isDeepStrictEqual(await during(1500), [0, []]));
  assert.deepEqual(await during(5000), [0, []]);
});

test('the page comes back after the server was killed and restarted', async () => {
  await server.kill();
  await until('the page says so', async () => /Next try|Trying now/.test(await cardText(page)));
  const { pictures } = traffic;
  server = await startServer({ data, port: server.port, args: SCENE });
  await until('a new picture', () => traffic.pictures > pictures, SLOW_MS);
  await settled();
  await until('the message is gone', async () => (await cardText(page)) === '');
});

test('the description of the HTTP interface is there', async () => {
  const docs = await browser.newPage();
  docs.setDefaultTimeout(SLOW_MS);
  await docs.goto(`${server.address}/docs`);
  await docs.getByRole('heading', { name: /POST \/v1\/renders/ }).first().waitFor();
  await docs.close();
});
