import assert from 'node:assert/strict';
import test from 'node:test';
import { isDeepStrictEqual } from 'node:util';
import { centre, hasConverged, onStage, until, withBrowser } from './support/stage.js';
import { colorAt } from './support/browser.js';
import { FLAGS } from './support/frame.js';

withBrowser();

test('the page loads, draws the stream and says when it has converged', onStage(async ({ page, server }) => {
  const [r, g, b] = await colorAt(page, 0.5, 0.3);
  assert.ok(r + g + b > 60, 'the wall is on the canvas');
  assert.match(await page.locator('#hud').innerText(), /Converged: RMSE 0\.0062 ± 0\.0008/);
  assert.equal(await page.title(), 'Cornell box · surfelcast');
  assert.match(await page.locator('#stats-panel').innerText(), /Samples per pixel\s*256/);
  const [hello, view, camera] = server.messages;
  assert.deepEqual([hello.t, view.t, camera.t], ['hello', 'view.set', 'camera']);
  assert.deepEqual(hello.caps.codecs, ['webp', 'jpeg', 'png']);
  const { box } = await centre(page);
  assert.deepEqual([view.w, view.h], [Math.round(box.width), Math.round(box.height)]);
}));

test('every frame is acknowledged, and input to photon is measured', onStage(async ({ page, server }) => {
  await until('all frames acknowledged', () => server.client.acked === server.client.frameSeq);
  const acks = server.received('ack');
  assert.ok(acks.every(({ seq, decode_us, present_ms }) => seq > 0 && decode_us >= 0 && present_ms > 0));
  assert.match(await page.locator('#stats-panel').innerText(), /Input to photon, p50 \/ p95\s*[\d.]+ ms \/ [\d.]+ ms/);
}));

test('a page that decodes slowly converges too, with the final frame', onStage(
  async ({ page }) => {
    await page.addInitScript(() => {
      const decode = window.createImageBitmap;
      window.createImageBitmap = async (...parts) => {
        await new Promise((resolve) => setTimeout(resolve, 400));
        return decode(...parts);
      };
      window.addEventListener('frame', ({ detail }) => (window.lastFrame = detail), true);
    });
    await page.reload();
    await hasConverged(page);
    assert.ok((await page.evaluate(() => window.lastFrame.flags)) & FLAGS.FINAL);
  },
));

test('during movement the page states why the resolution is reduced', onStage(async ({ page }) => {
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let step = 1; step <= 10; step += 1) {
    await page.mouse.move(x + 8 * step, y);
    await page.waitForTimeout(60);
  }
  await page.locator('#hud[data-state=moving] .progress', { hasText: '50 % resolution: the device cannot render full frames in time' }).waitFor();
  await page.mouse.up();
  await hasConverged(page);
  assert.doesNotMatch(await page.locator('#hud').innerText(), /resolution/);
}));

const countFrames = () => {
  window.animationFrames = 0;
  window.timersRun = 0;
  const request = window.requestAnimationFrame;
  window.requestAnimationFrame = (run) => request((time) => {
    window.animationFrames += 1;
    run(time);
  });
  const later = window.setTimeout;
  window.setTimeout = (run, ms, ...rest) => later(() => {
    window.timersRun += 1;
    run(...rest);
  }, ms);
};

test('a converged page does no work and sends nothing', onStage(
  async ({ page, server }) => {
    await page.addInitScript(countFrames);
    await page.reload();
    await hasConverged(page);
    const work = async () => [...(await page.evaluate(() => [window.animationFrames, window.timersRun])), server.messages.length];
    assert.ok((await work())[0] > 0, 'animation frames are counted');
    // The rates fall back to zero within about a second and a half.
    await until('rest', async () => {
      const before = await work();
      await page.waitForTimeout(2500);
      return isDeepStrictEqual(await work(), before);
    });
    assert.match(await page.locator('#stats-panel').innerText(), /Frames per second\s*0\b/);
  },
));

test('the query limits samples and resolution', onStage(
  async ({ page, server }) => {
    const first = server.received('view.set')[0];
    const { box } = await centre(page);
    assert.equal(first.max_spp, 32);
    assert.deepEqual([first.w, first.h], [Math.round(box.width / 2), Math.round(box.height / 2)]);
  },
  { path: '/?max_spp=32&resolution=0.5' },
));

test('the image can be saved as PNG', onStage(async ({ page }) => {
  const [download] = await Promise.all([page.waitForEvent('download'), page.getByRole('button', { name: 'Save the image' }).click()]);
  assert.equal(download.suggestedFilename(), 'surfelcast-cornell-box.png');
  const chunks = [];
  for await (const chunk of await download.createReadStream()) chunks.push(chunk);
  const file = Buffer.concat(chunks);
  const { box } = await centre(page);
  assert.equal(file.subarray(1, 4).toString(), 'PNG');
  assert.deepEqual([file.readUInt32BE(16), file.readUInt32BE(20)], [Math.round(box.width), Math.round(box.height)]);
}));

test('a frame that cannot be decoded is reported until the next one is shown', onStage(async ({ page, server }) => {
  const good = server.client.draw;
  server.client.draw = () => Buffer.from('not an image');
  await page.evaluate(() => document.querySelector('surfelcast-view').requestStill());
  server.client.touch();
  const card = page.locator('surfelcast-view').getByText('A frame could not be decoded', { exact: true });
  await card.waitFor();
  server.client.draw = good;
  server.client.touch();
  await card.waitFor({ state: 'hidden' });
}));

test('a browser without a needed feature is told which', onStage(
  async ({ page, server }) => {
    await page.addInitScript(() => delete window.createImageBitmap);
    const before = server.received('hello').length;
    await page.reload();
    const view = page.locator('surfelcast-view');
    await view.getByText('This browser cannot show the view', { exact: true }).waitFor();
    assert.match(await view.locator('.words').innerText(), /createImageBitmap/);
    assert.equal(server.received('hello').length, before);
  },
));

test('the element works alone on a page of its own', onStage(async ({ page, server }) => {
  await page.evaluate(() => {
    const alone = document.createElement('surfelcast-view');
    alone.setAttribute('src', '/v1/sessions/session-1/stream');
    document.body.replaceChildren(alone);
  });
  await until('a second connection', () => server.received('hello').length === 2);
  await until('a frame on the canvas', async () => (await colorAt(page, 0.5, 0.3)).some((part) => part > 40));
  await page.evaluate(() => document.querySelector('surfelcast-view').remove());
  await until('it disconnects when removed', () => server.sockets.clients.size === 0);
}));

test('the description of the HTTP interface is shown as a page', onStage(
  async ({ page }) => {
    await page.getByRole('heading', { name: /POST \/v1\/scenes/ }).waitFor();
    const text = await page.locator('main').innerText();
    assert.match(text, /Uploads a scene\n/, 'backticks have become code');
    assert.match(text, /model\/gltf-binary/);
    assert.match(text, /triangle_count/);
    await page.locator('main').getByRole('link', { name: 'Scene', exact: true }).first().click();
    assert.match(page.url(), /#schema-Scene$/);
  },
  {
    path: '/docs',
    converged: false,
    prepare: (server) => {
      server.openapi = {
        openapi: '3.1.0',
        info: { title: 'surfelcast', version: '0.1.0', description: 'Renders scenes.\n\nErrors are `application/problem+json`.' },
        paths: {
          '/v1/scenes': {
            post: {
              summary: 'Uploads a `scene`',
              parameters: [{ name: 'Idempotency-Key', in: 'header', schema: { type: 'string', maxLength: 64 } }],
              requestBody: { content: { 'model/gltf-binary': { schema: { type: 'string', format: 'binary' } } } },
              responses: { 201: { description: 'Created', content: { 'application/json': { schema: { $ref: '#/components/schemas/Scene' } } } }, 413: { description: 'Too large' } },
            },
          },
        },
        components: { schemas: { Scene: { type: 'object', required: ['id'], properties: { id: { type: 'string' }, triangle_count: { type: 'integer', minimum: 0 } } } } },
      };
    },
  },
));
