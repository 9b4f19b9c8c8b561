import assert from 'node:assert/strict';
import test from 'node:test';
import { hasConverged, onStage, until, withBrowser } from './support/stage.js';

withBrowser();

const lights = (server) => server.received('light');

test('lights are listed, edited, added and removed', onStage(async ({ page, server }) => {
  const panel = page.locator('#lights-panel');
  const lamp = panel.locator('.light', { hasText: 'Desk lamp' });
  await lamp.locator('summary').click();

  await lamp.getByRole('spinbutton', { name: /^Intensity/ }).fill('40');
  await lamp.getByRole('spinbutton', { name: /^Intensity/ }).press('Enter');
  await until('the intensity', () => lights(server).at(-1)?.patch.set?.intensity === 40);
  assert.deepEqual([lights(server).length, lights(server)[0].phase, lights(server)[0].patch.set.id], [1, 'end', 2]);

  await lamp.getByRole('spinbutton', { name: 'Position Y' }).fill('1.25');
  await lamp.getByRole('spinbutton', { name: 'Position Y' }).press('Enter');
  await until('the position', () => lights(server).at(-1).patch.set?.position[1] === 1.25);

  await lamp.getByRole('button', { name: /Move along X/ }).press('ArrowRight');
  await until('the nudge', () => lights(server).at(-1).patch.set?.position[0] > 0.5);

  await lamp.getByLabel('Colour of Desk lamp').fill('#ff0000');
  await until('the colour', () => lights(server).at(-1).patch.set?.color.join() === '1,0,0' && lights(server).at(-1).phase === 'end');

  await lamp.getByRole('switch').click();
  await until('off', () => lights(server).at(-1).patch.set?.enabled === false);

  await panel.getByRole('button', { name: 'Add point light' }).click();
  await until('the new light', () => lights(server).at(-1).patch.add?.kind === 'point');
  const added = panel.locator('.light', { hasText: 'Point light' });
  await added.getByRole('button', { name: 'Remove' }).click();
  await until('the removal', () => lights(server).at(-1).patch.remove === 3);
  await added.waitFor({ state: 'detached' });
}));

test('a dragged slider sends start, moves and end, and keeps under the hand', onStage(async ({ page, server }) => {
  const strength = page.locator('#lights-panel').getByRole('slider', { name: 'Environment' });
  const box = await strength.boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.8, box.y + box.height / 2, { steps: 15 });
  await page.mouse.up();
  await until('the end', () => lights(server).at(-1)?.phase === 'end');
  const phases = lights(server).map(({ phase }) => phase);
  assert.equal(phases[0], 'start');
  assert.ok(phases.includes('move'));
  assert.equal(phases.filter((phase) => phase === 'end').length, 1);
  const { environment_strength: sent } = lights(server).at(-1).patch;
  assert.ok(sent > 3, `strength ${sent}`);
  const shown = Number(await page.locator('#lights-panel').getByRole('spinbutton', { name: /Environment/ }).inputValue());
  assert.ok(Math.abs(shown - sent) < 0.01 * sent, `${shown} shown`);
}));

test('the sun is turned by azimuth and elevation', onStage(async ({ page, server }) => {
  const sun = page.locator('#lights-panel .light').first();
  await sun.locator('summary').click();
  for (const [name, value] of [['Azimuth', '90'], ['Elevation', '30']]) {
    const input = sun.getByRole('spinbutton', { name: new RegExp(`^${name}`) });
    await input.fill(value);
    await input.press('Enter');
  }
  await until('both edits', () => lights(server).length === 2);
  const [x, y, z] = lights(server).at(-1).patch.set.direction;
  assert.ok(Math.abs(x + Math.cos(Math.PI / 6)) < 1e-9 && Math.abs(y + 0.5) < 1e-9 && Math.abs(z) < 1e-9);
}));

test('another person moving a light is seen here', onStage(async ({ page, server }) => {
  server.editLights({ set: { ...server.lights.lights[0], name: 'Evening sun' } });
  server.client.sendLights();
  await page.locator('#lights-panel').getByText('Evening sun').waitFor();
}));

test('what is typed into a field outlives the edits of others', onStage(async ({ page, server }) => {
  const panel = page.locator('#lights-panel');
  let echoes = 0;
  // Somebody else's edit, seen to have arrived.
  const echo = async (change = {}) => {
    const name = `Lamp ${(echoes += 1)}`;
    server.editLights({ set: { ...server.lights.lights[1], name, ...change } });
    server.client.sendLights();
    await panel.getByText(name, { exact: true }).waitFor();
  };
  for (const light of await panel.locator('.light summary').all()) await light.click();
  const sun = panel.locator('.light').first();
  const lamp = panel.locator('.light').nth(1);
  for (const [where, name, typed, sent] of [
    [sun, 'Azimuth', '90', ({ set }) => Math.abs(set.direction[0] / Math.hypot(set.direction[0], set.direction[2]) + 1) < 1e-9],
    [sun, 'Elevation', '30', ({ set }) => Math.abs(set.direction[1] + 0.5) < 1e-9],
    [sun, 'Intensity', '4', ({ set }) => set.intensity === 4],
    [lamp, 'Core', '10', ({ set }) => set.cone_deg.join() === '10,40'],
    [lamp, 'Position Y', '1.25', ({ set }) => set.position.join() === '0.5,1.25,0'],
    [panel, 'Environment', '0.5', (patch) => patch.environment_strength === 0.5],
    [panel, 'Emission', '2', (patch) => patch.emissive_strength === 2],
  ]) {
    const input = where.getByRole('spinbutton', { name: new RegExp(`^${name}`) });
    const before = lights(server).length;
    await input.fill(typed);
    await echo();
    assert.equal(await input.inputValue(), typed, name);
    await input.press('Enter');
    await until(name, () => lights(server).length > before);
    assert.ok(sent(lights(server).at(-1).patch), `${name}: ${JSON.stringify(lights(server).at(-1).patch)}`);
  }

  // The rest of the same light follows while one of its fields is typed into, and is not undone by what was typed.
  const [x, y] = ['X', 'Y'].map((axis) => lamp.getByRole('spinbutton', { name: `Position ${axis}` }));
  await y.pressSequentially('5');
  await echo({ position: [7, 1.5, 0] });
  assert.deepEqual([await x.inputValue(), await y.inputValue()], ['7', '1.255']);
  await x.focus();
  await until('leaving submits', () => lights(server).at(-1).patch.set?.position.join() === '7,1.255,0');

  // Escape gives up what was typed, and nothing is said.
  const { length } = lights(server);
  await y.fill('3');
  await echo({ position: [7, 2, 0] });
  await y.press('Escape');
  assert.equal(await y.inputValue(), '2');
  await y.fill('');
  await x.focus();
  assert.equal(await y.inputValue(), '2');
  await echo({ position: [8, 2.5, 0] });
  assert.deepEqual([await x.inputValue(), await y.inputValue()], ['7', '2.5'], 'a field about to be typed into stays still');
  await y.focus();
  assert.equal(await x.inputValue(), '8');
  assert.equal(lights(server).length, length);
}));

test('echoes of earlier edits do not undo later ones', onStage(async ({ page, server }) => {
  const panel = page.locator('#lights-panel');
  const lamp = panel.locator('.light').nth(1);
  await lamp.locator('summary').click();
  const value = (name) => panel.getByRole('spinbutton', { name: new RegExp(`^${name}`) }).inputValue();
  const step = (1.75 / 400) * 10;
  // A slow connection: edits arrive, but the test decides when echo and frame come back.
  const { client } = server;
  const sendLights = client.sendLights.bind(client);
  client.sendLights = () => {};
  server.silent = true;
  const handle = lamp.getByRole('button', { name: /Move along X/ });
  await handle.press('ArrowRight');
  await until('the first edit', () => lights(server).length === 1);
  const once = structuredClone(server.lights);
  await handle.press('ArrowRight');
  await until('the second edit', () => lights(server).length === 2);
  const twice = server.lights;
  server.lights = { ...once, environment_strength: 3 };
  sendLights();
  await until('the echo of the first, with what somebody else did', async () => (await value('Environment')) === '3');
  server.lights = twice;
  await handle.press('ArrowRight');
  await until('the third edit', () => lights(server).length === 3);
  const [x] = lights(server).at(-1).patch.set.position;
  assert.ok(Math.abs(x - 0.5 - 3 * step) < 1e-9, `three steps of ${step} from 0.5 to ${x}`);

  // Once a frame contains the edits, the server's state is shown again; also after a refusal.
  server.editLights({ set: { ...server.lights.lights[1], position: [7, 1, 0] }, emissive_strength: 4 });
  sendLights();
  await until('the rest', async () => (await value('Emission')) === '4');
  assert.notEqual(await value('Position X'), '7');
  server.silent = false;
  client.touch();
  await until('the frame', async () => (await value('Position X')) === '7');
  server.silent = true;
  await handle.press('ArrowRight');
  await until('the fourth edit', () => lights(server).length === 4);
  assert.notEqual(await value('Position X'), '7');
  client.send({ t: 'error', code: 'invalid', detail: 'patch.set.position: too far away' });
  await until('the former value', async () => (await value('Position X')) === '7');
}));

test('exposure is sent as a factor, technique by its id, and both survive a reconnect', onStage(
  async ({ page, server }) => {
    const exposure = page.locator('#view-panel').getByRole('spinbutton', { name: /Exposure/ });
    await exposure.fill('2');
    await exposure.press('Enter');
    await until('the factor', () => server.received('view.set').at(-1).exposure === 4);
    await page.getByLabel('Technique').selectOption('cache');
    await until('the technique', () => server.received('view.set').at(-1).technique === 'cache');
    assert.match(await page.locator('#view-panel').innerText(), /Persistent cache of indirect light/);
    server.client.socket.terminate();
    await until('a new connection', () => server.received('hello').length === 2 && server.received('view.set').at(-1).w);
    const settings = server.received('view.set').at(-1);
    assert.deepEqual([settings.exposure, settings.technique], [4, 'cache']);
  },
));

test('settings and presets of a technique are shown from their descriptors', onStage(async ({ page }) => {
  const panel = page.locator('#view-panel');
  assert.equal(await panel.getByText(/\d+ settings?/).isVisible(), false, 'the first technique has none');
  await page.getByLabel('Technique').selectOption('cache');
  await panel.getByText('3 settings').click();
  const rows = async () => (await panel.locator('.settings > div').allInnerTexts()).map((text) => text.replace(/\s+/g, ' '));
  assert.deepEqual(await rows(), [
    'Radius radius 5 pixels 1.5 to 32: Smaller shows more detail.',
    'Depth depth on on or off: Respects walls.',
    'Grid grid cascades cascades, trapezoidal: How records are found.',
  ]);
  await page.getByLabel('Preset').selectOption('high');
  assert.deepEqual((await rows()).map((row) => row.split(' ')[2]), ['3', 'on', 'trapezoidal']);
  assert.equal(await panel.locator('.settings > .changed').count(), 2);
  await page.getByLabel('Technique').selectOption('path');
  assert.equal(await panel.getByText('3 settings').isVisible(), false);
}));

test('import warnings are shown', onStage(async ({ page }) => {
  const warnings = page.locator('.warnings');
  await warnings.locator('summary').click();
  assert.match(await warnings.innerText(), /1 note from the import\s+KHR_materials_clearcoat/);
}));

test('scenes can be switched', onStage(async ({ page, server }) => {
  await page.getByLabel('Scene', { exact: true }).selectOption({ label: 'Interior' });
  await until('a new stream', () => server.received('hello').length === 2);
  await until('its title', async () => (await page.title()) === 'Interior · surfelcast');
  const hello = server.received('hello').at(-1);
  assert.equal('resume' in hello, false, 'the token belongs to the other session');
  // A scene without cameras of its own is framed as a whole.
  const { pose } = await until('its camera', () => server.messages.slice(server.messages.indexOf(hello)).find(({ t }) => t === 'camera'));
  assert.deepEqual(pose.target, [0, 1, 0]);
  assert.ok(pose.eye[2] > 3 && pose.eye[0] > 1);
  await hasConverged(page);
}));

const glb = { name: 'room.glb', mimeType: 'model/gltf-binary', buffer: Buffer.from('glTF') };

test('an uploaded file is opened', onStage(async ({ page, server }) => {
  await page.locator('#file').setInputFiles(glb);
  await until('its stream', () => server.received('hello').length === 2);
  assert.equal(await page.getByLabel('Scene', { exact: true }).evaluate((select) => select.selectedOptions[0].text), 'Interior');
}));

test('a refused upload shows the message of the server', onStage(
  async ({ page }) => {
    await page.locator('#file').setInputFiles(glb);
    const toast = page.locator('#toasts .toast');
    await toast.waitFor();
    assert.match(await toast.innerText(), /Scene too large: the file has 9 MB, the limit is 8 MB; simplify the scene/);
    await toast.getByRole('button', { name: 'Dismiss' }).click();
    await toast.waitFor({ state: 'detached' });
  },
  {
    allow: /413/,
    prepare: (server) => {
      server.uploadAnswer = {
        status: 413,
        body: { type: 'about:blank', title: 'Scene too large', status: 413, code: 'scene_too_large', detail: 'the file has 9 MB, the limit is 8 MB; simplify the scene' },
      };
    },
  },
));

test('a dropped file is opened, and one of another kind is refused', onStage(async ({ page, server }) => {
  const drop = (name) =>
    page.evaluate((fileName) => {
      const data = new DataTransfer();
      data.items.add(new File(['glTF'], fileName));
      for (const type of ['dragenter', 'dragover', 'drop']) {
        document.body.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: data }));
      }
    }, name);
  await drop('holiday.jpg');
  await page.getByText('holiday.jpg is not a .glb file').waitFor();
  await drop('room.glb');
  await until('its stream', () => server.received('hello').length === 2);
}));

test('refusals of the server are shown', onStage(async ({ page, server }) => {
  server.client.send({ t: 'error', code: 'too_many_lights', detail: 'the session has 256 lights, the limit; remove one first' });
  await page.getByText('the session has 256 lights').waitFor();
}));
