/**
 * Outputs of the renderer, and the inspection of a point.
 */

import assert from 'node:assert/strict';
import test from 'node:test';
import { colorAt } from './support/browser.js';
import { poorContrast } from './support/contrast.js';
import { inspectionOf } from './support/fake-server.js';
import { centre, hasConverged, onStage, until, withBrowser } from './support/stage.js';

withBrowser();

const phone = { context: { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 } };

const inspects = (server) => server.received('inspect');
const toggle = (page) => page.getByRole('button', { name: 'Inspect', exact: true });
const panel = (page) => page.locator('#panel-inspect');
const marker = (page) => page.locator('surfelcast-view').locator('.marker');

/** Clicks a fraction of the image. */
async function click(page, x, y) {
  const { box } = await centre(page);
  await page.mouse.click(box.x + box.width * x, box.y + box.height * y);
}

test('the view shows an output and goes back to radiance', onStage(async ({ page, server }) => {
  const show = page.getByLabel('Show', { exact: true });
  const panel = page.locator('#view-panel');
  assert.deepEqual(await show.locator('option').allInnerTexts(), ['Radiance', 'Normal', 'Variance']);
  assert.equal('aov' in server.received('view.set')[0], false, 'no output is sent before one is chosen');
  await show.selectOption({ label: 'Variance' });
  await until('the setting', () => server.received('view.set').at(-1).aov === 'variance');
  await panel.getByText('Variance of the mean.').waitFor();
  await until('its image', async () => (await colorAt(page, 0.5, 0.3)).join() === '20,200,40');
  server.client.socket.terminate();
  await until('a new connection', () => server.received('hello').length === 2 && server.received('view.set').at(-1).w);
  assert.equal(server.received('view.set').at(-1).aov, 'variance', 'the setting outlives the connection');
  await until('the choice too', async () => (await show.inputValue()) === 'variance');
  await show.selectOption({ label: 'Radiance' });
  await until('radiance again', () => server.received('view.set').at(-1).aov === null);
  await until('the former image', async () => (await colorAt(page, 0.5, 0.3)).join() !== '20,200,40');
  await hasConverged(page);
}));

test('outputs of one technique are offered with it alone', onStage(async ({ page, server }) => {
  const show = page.getByLabel('Show', { exact: true });
  await page.getByLabel('Technique').selectOption('cache');
  assert.deepEqual(await show.locator('option').allInnerTexts(), ['Radiance', 'Normal', 'Variance', 'Coverage']);
  await show.selectOption({ label: 'Coverage' });
  await until('the setting', () => server.received('view.set').at(-1).aov === 'cache_coverage');
  await page.getByLabel('Technique').selectOption('path');
  await until('radiance again', () => server.received('view.set').at(-1).aov === null);
  assert.equal(await show.inputValue(), '');
}));

test('without outputs there is nothing to choose', onStage(
  async ({ page }) => {
    const show = page.getByLabel('Show', { exact: true });
    assert.deepEqual([await show.isDisabled(), await show.locator('option').allInnerTexts()], [true, ['Radiance']]);
  },
  {
    prepare: (server) => {
      const { welcome } = server;
      server.welcome = (other) => ({ ...welcome.call(server, other), outputs: undefined });
    },
  },
));

test('a click inspects while the mode is on, and only then', onStage(async ({ page, server }) => {
  await click(page, 0.25, 0.5);
  assert.equal(await panel(page).isVisible(), false);
  await toggle(page).click();
  assert.equal(await toggle(page).getAttribute('aria-pressed'), 'true');
  await panel(page).getByText('Click a point of the image').waitFor();
  assert.ok(await page.getByRole('button', { name: 'Copy JSON' }).isDisabled(), 'there is nothing to copy yet');
  await click(page, 0.25, 0.75);
  await panel(page).getByText('24 surfels light this point.').waitFor();
  const [requested] = inspects(server);
  assert.equal(inspects(server).length, 1, 'the click before the mode requested nothing');
  assert.ok(Math.abs(requested.x - 0.25) < 0.01 && Math.abs(requested.y - 0.75) < 0.01 && requested.view === 0 && requested.id > 0);
  const text = await panel(page).innerText();
  for (const figure of [/Position\s*m\s*0\.250\s+0\s+-0\.125/, /Normal\s*0\s+1\.00\s+0/, /Coverage\s*1\.25/, /Trust\s*0\.750/, /Irradiance \/ π\s*0\.625\s+0\.500\s+0\.350/, /Direct\s*0\.500/, /Indirect\s*0\.125/]) {
    assert.match(text, figure);
  }
  const rows = panel(page).locator('tbody tr');
  assert.equal(await rows.count(), 24);
  assert.deepEqual(await rows.first().locator('th, td').allInnerTexts(), ['120000', '8.0 %', '4,096', '6.2 cm', '0.0021']);
  const mark = await marker(page).boundingBox();
  const { box } = await centre(page);
  assert.ok(Math.abs(mark.x + mark.width / 2 - box.x - box.width / 4) < 2, 'the point is marked');
  assert.equal(server.received('camera').length, 1, 'the camera stays');
}));

test('in the mode a double click does not focus, a drag still orbits, and the mark goes', onStage(async ({ page, server }) => {
  await toggle(page).click();
  const { x, y } = await centre(page);
  await page.mouse.dblclick(x, y);
  await panel(page).getByText('24 surfels').waitFor();
  assert.equal(server.received('pick').length, 0);
  assert.ok(await marker(page).isVisible());
  const requested = inspects(server).length;
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 80, y, { steps: 6 });
  await page.mouse.up();
  await until('the gesture', () => server.received('camera').at(-1).phase === 'end' && server.received('camera').length > 2);
  assert.equal(inspects(server).length, requested);
  assert.equal(await marker(page).isVisible(), false);
}));

test('the answer can be copied as JSON', onStage(
  async ({ page, server, context }) => {
    await context.grantPermissions(['clipboard-read', 'clipboard-write']);
    await toggle(page).click();
    await click(page, 0.5, 0.5);
    await page.getByRole('button', { name: 'Copy JSON' }).click();
    await page.getByText('copied as JSON').waitFor();
    const copied = await page.evaluate(() => navigator.clipboard.readText());
    assert.deepEqual(JSON.parse(copied), server.inspection);
    // Without the clipboard API the page copies a selection.
    server.inspection = inspectionOf(1);
    await click(page, 0.4, 0.5);
    await panel(page).getByText('1 surfel lights this point.').waitFor();
    await page.evaluate(() => Object.defineProperty(navigator.clipboard, 'writeText', { value: () => Promise.reject(new Error('no')) }));
    await page.getByRole('button', { name: 'Copy JSON' }).click();
    const again = JSON.stringify(server.inspection, undefined, 2);
    await until('the copy', async () => (await page.evaluate(() => navigator.clipboard.readText())) === again);
  },
));

test('one request at a time; the newest click is answered', onStage(
  async ({ page, server }) => {
    await toggle(page).click();
    for (const x of [0.2, 0.3, 0.4, 0.5, 0.6]) await click(page, x, 0.5);
    await panel(page).getByText('Waiting for the server…').waitFor();
    await until('the first request', () => inspects(server).length === 1);
    server.client.answerInspections();
    await until('the newest one', () => inspects(server).length === 2);
    assert.ok(Math.abs(inspects(server)[1].x - 0.6) < 0.01);
    assert.equal(await panel(page).locator('tbody tr').count(), 0, 'the answer to an older point is not shown');
    server.client.answerInspections();
    await panel(page).getByText('24 surfels').waitFor();
  },
  { prepare: (server) => (server.holdInspections = true) },
));

test('a refusal and a point without surfels are shown in the panel', onStage(async ({ page, server }) => {
  await toggle(page).click();
  await click(page, 0.5, 0.5);
  await panel(page).getByText('24 surfels').waitFor();
  server.inspection = null;
  await click(page, 0.5, 0.4);
  await panel(page).getByText('Nothing to show here').waitFor();
  assert.equal(await panel(page).locator('.found').isVisible(), false);
  server.inspectRefusal = { code: 'inspect_failed', detail: 'inspect: the render device was lost' };
  await click(page, 0.5, 0.3);
  await panel(page).getByText('inspect: the render device was lost').waitFor();
  assert.equal(await page.locator('#toasts .toast').count(), 0, 'it is shown once');
}));

test('the keyboard alone turns the mode on and off', onStage(async ({ page, server }) => {
  await toggle(page).focus();
  await page.keyboard.press('Enter');
  await panel(page).waitFor();
  await page.locator('surfelcast-view').locator('canvas').focus();
  await page.keyboard.press('Enter');
  await panel(page).getByText('24 surfels').waitFor();
  assert.deepEqual([inspects(server)[0].x, inspects(server)[0].y], [0.5, 0.5]);
  await page.keyboard.press('Escape');
  await panel(page).waitFor({ state: 'hidden' });
  assert.equal(await toggle(page).getAttribute('aria-pressed'), 'false');
  assert.equal(await marker(page).isVisible(), false);
  await page.keyboard.press('Enter');
  // From inside the panel as well, and the mode begins empty.
  await toggle(page).focus();
  await page.keyboard.press('Space');
  await panel(page).getByText('Click a point').waitFor();
  assert.equal(inspects(server).length, 1, 'outside the mode Enter requests nothing');
  await page.getByRole('button', { name: 'Centre of the image' }).press('Enter');
  await panel(page).getByText('24 surfels').waitFor();
  await panel(page).getByRole('region', { name: /What lights/ }).focus();
  await page.keyboard.press('Escape');
  await panel(page).waitFor({ state: 'hidden' });
}));

test('Escape ends flying first, a dialog first, and discards typed text first', onStage(async ({ page }) => {
  await toggle(page).click();
  await page.getByRole('button', { name: 'Controls' }).click();
  await page.keyboard.press('Escape');
  await page.locator('dialog').waitFor({ state: 'hidden' });
  assert.ok(await panel(page).isVisible());
  const exposure = page.getByRole('spinbutton', { name: /Exposure/ });
  await exposure.fill('2');
  await exposure.press('Escape');
  assert.deepEqual([await exposure.inputValue(), await panel(page).isVisible()], ['0', true]);
  await page.locator('surfelcast-view').locator('canvas').focus();
  await page.keyboard.press('f');
  await page.locator('surfelcast-view').getByText('Flying').waitFor();
  assert.equal(await page.locator('surfelcast-view').getByText('Inspecting').isVisible(), false);
  await page.keyboard.press('Escape');
  await page.locator('surfelcast-view').getByText('Flying').waitFor({ state: 'hidden' });
  assert.ok(await panel(page).isVisible());
  await page.keyboard.press('Escape');
  await panel(page).waitFor({ state: 'hidden' });
}));

test('a request on a lost connection is not waited for', onStage(
  async ({ page, server }) => {
    await toggle(page).click();
    await click(page, 0.5, 0.5);
    await panel(page).getByText('Waiting for the server…').waitFor();
    server.client.socket.terminate();
    await panel(page).getByText('Click a point').waitFor();
    server.holdInspections = false;
    await until('a new connection', () => server.received('hello').length === 2);
    await hasConverged(page);
    await click(page, 0.5, 0.5);
    await panel(page).getByText('24 surfels').waitFor();
  },
  { prepare: (server) => (server.holdInspections = true) },
));

test('on a phone the answer is scrolled into view below the point, and fits', onStage(async ({ page, server }) => {
  await page.getByRole('button', { name: 'View', exact: true }).tap();
  await toggle(page).tap();
  const tap = async (x, y) => {
    const { box } = await centre(page);
    await page.touchscreen.tap(box.x + box.width * x, box.y + box.height * y);
  };
  await tap(0.5, 0.25);
  await panel(page).getByText('24 surfels').waitFor();
  assert.ok(Math.abs(inspects(server)[0].y - 0.25) < 0.01);
  const isInView = () =>
    page.evaluate(() => {
      const status = document.querySelector('.inspector [role=status]').getBoundingClientRect();
      const scroll = document.querySelector('.sheet .scroll').getBoundingClientRect();
      return status.height > 0 && status.top >= scroll.top - 1 && status.bottom <= scroll.bottom + 1;
    });
  assert.ok(await isInView());
  const sheet = await page.locator('#sheet').boundingBox();
  const { y } = await centre(page);
  assert.ok(sheet.y > y, 'the centre of the image stays visible');
  const overflow = await page.evaluate(() => {
    const table = document.querySelector('.contributions');
    return [document.documentElement.scrollWidth - innerWidth, table.scrollWidth - table.clientWidth];
  });
  assert.ok(overflow.every((width) => width <= 0), overflow.join());
  // With the sheet closed, the answer opens it.
  await page.getByRole('button', { name: 'View', exact: true }).tap();
  assert.equal(await panel(page).isVisible(), false);
  await tap(0.4, 0.2);
  await until('the answer in view', isInView);
  const small = await panel(page).locator('button').evaluateAll((buttons) => buttons.filter((button) => button.getBoundingClientRect().height < 36).length);
  assert.equal(small, 0);
}, phone));

for (const colorScheme of ['light', 'dark']) {
  test(`the inspector is readable in ${colorScheme}`, onStage(
    async ({ page }) => {
      await toggle(page).click();
      await click(page, 0.5, 0.5);
      await panel(page).getByText('24 surfels').waitFor();
      assert.deepEqual(await poorContrast(page, '#panel-inspect *, #view-panel button'), []);
    },
    { context: { colorScheme } },
  ));
}
