import assert from 'node:assert/strict';
import test from 'node:test';
import { cardText, centre, hasConverged, onStage, until, withBrowser } from './support/stage.js';
import { FakeServer } from './support/fake-server.js';
import { colorAt } from './support/browser.js';

withBrowser();

// A page whose server does not answer logs failed requests, as these tests intend.
const away = { allow: /net::ERR_|WebSocket connection|status of 503|404/ };

test('after the server was killed the page counts down and reconnects with camera and token', onStage(async ({ page, server }) => {
  const { x, y } = await centre(page);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 100, y, { steps: 5 });
  await page.mouse.up();
  await until('the orbit', () => server.received('camera').at(-1).phase === 'end');
  const { pose } = server.received('camera').at(-1);
  const { port } = server;
  await server.kill();
  await until('the message', async () => /not answering.*Next attempt in \d+ s.*Try now/.test(await cardText(page)));
  assert.equal(await page.locator('#lights-panel').evaluate((fields) => fields.disabled), true);
  const [r, g, b] = await colorAt(page, 0.5, 0.3);
  assert.ok(r + g + b > 60, 'the last frame stays');
  const card = await page.locator('surfelcast-view').locator('.card').boundingBox();
  const view = (await centre(page)).box;
  assert.ok(card.y > view.y + view.height * 0.6, 'and the message does not cover its centre');

  const back = await new FakeServer().start(port);
  try {
    await until('hello again', () => back.received('hello').length > 0);
    assert.equal(back.received('hello')[0].resume, 'token-1');
    await until('the camera', () => back.received('camera').length > 0);
    assert.deepEqual(back.received('camera')[0].pose, pose);
    await hasConverged(page);
    assert.equal(await cardText(page), '');
  } finally {
    await back.kill();
  }
}, away));

test('after a restart the same scene is found in its new session', onStage(async ({ page, server }) => {
  const { port } = server;
  await server.kill();
  const back = new FakeServer();
  back.session = 'another-id';
  await back.start(port);
  try {
    await until('hello in the new session', () => back.received('hello').length > 0);
    await hasConverged(page);
  } finally {
    await back.kill();
  }
}, away));

test('a full server is reported as such, and retried later', onStage(
  async ({ page, server }) => {
    await until('the message', async () => /render server is full.*Next attempt in [45] s/.test(await cardText(page)));
    // In one step: the page retries by itself after a while, which hides the button.
    const retried = () => page.locator('surfelcast-view').evaluate(({ shadowRoot }) => {
      const button = shadowRoot.querySelector('.card button');
      if (button.hidden) return false;
      button.click();
      return shadowRoot.querySelector('.card').textContent.includes('Connecting now');
    });
    server.closeWith = undefined;
    await until('an early attempt', retried);
    await hasConverged(page);
    assert.equal(await cardText(page), '');
  },
  { converged: false, prepare: (server) => { server.closeWith = 1013; } },
));

for (const [code, text] of [
  [4503, /render server is full/],
  [4507, /graphics device failed/],
  [1012, /restarting/],
  [4409, /continues elsewhere.*Resume here/],
  [4426, /has been updated.*Reload/],
  [1008, /may not use the render server/],
]) {
  test(`close code ${code} has a message`, onStage(async ({ page, server }) => {
    // On every attempt, or the next one would remove the message.
    server.closeWith = code;
    server.client.socket.close(code);
    await until('the message', async () => text.test(await cardText(page)));
    assert.match(await page.locator('surfelcast-view').locator('.live').textContent(), /\./, 'and announced');
  }));
}

test('a session that ended moves on to the new one of its scene', onStage(async ({ page, server }) => {
  server.session = 'session-2';
  server.client.socket.close(4404);
  await until('hello in the new session', () => server.received('hello').length === 2);
  await hasConverged(page);
}, away));

test('notices are shown and removed', onStage(async ({ page, server }) => {
  server.client.send({ t: 'notice', kind: 'device_lost', detail: 'Frames pause for a moment.' });
  await until('lost', async () => /graphics device failed; restoring it/.test(await cardText(page)));
  server.client.send({ t: 'notice', kind: 'restored', detail: '' });
  await until('restored', async () => (await cardText(page)) === '');
  server.client.send({ t: 'notice', kind: 'draining', detail: 'Back in a minute.' });
  await until('draining', async () => /about to restart.*Back in a minute/.test(await cardText(page)));
}));

test('a page opened before the server answers connects later', onStage(
  async ({ page, server }) => {
    await page.getByText('The render server does not answer').waitFor();
    assert.match(await page.locator('#away').innerText(), /Starting: scenes are being loaded/);
    server.problem = undefined;
    await hasConverged(page);
    await page.getByText('The render server does not answer').waitFor({ state: 'hidden' });
  },
  {
    ...away,
    converged: false,
    prepare: (server) => {
      server.problem = { type: 'about:blank', title: 'Starting', status: 503, code: 'starting', detail: 'scenes are being loaded' };
    },
  },
));
