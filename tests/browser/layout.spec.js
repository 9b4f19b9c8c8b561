import assert from 'node:assert/strict';
import test from 'node:test';
import { poorContrast } from './support/contrast.js';
import { onStage, withBrowser } from './support/stage.js';

withBrowser();

const phone = { context: { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 } };

test('on a phone nothing overflows and the panels are closed', onStage(async ({ page }) => {
  const overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  assert.ok(overflow <= 0, `${overflow} px too wide`);
  const view = await page.locator('surfelcast-view').boundingBox();
  assert.ok(view.width === 390 && view.height > 600);
  assert.equal(await page.locator('#view-panel').isVisible(), false);
}, phone));

for (const [tab, content] of [['View', '#view-panel'], ['Lights', '#lights-panel'], ['Statistics', '#stats-panel']]) {
  test(`on a phone the ${tab} sheet opens without covering the centre of the image`, onStage(async ({ page }) => {
    await page.getByRole('button', { name: tab, exact: true }).tap();
    assert.equal(await page.locator(content).isVisible(), true);
    const view = await page.locator('surfelcast-view').boundingBox();
    const sheet = await page.locator('#sheet').boundingBox();
    assert.ok(sheet.y > view.y + view.height / 2, `sheet at ${sheet.y}, centre at ${view.y + view.height / 2}`);
    await page.getByRole('button', { name: tab, exact: true }).tap();
    assert.equal(await page.locator(content).isVisible(), false);
  }, phone));
}

test('touch targets on a phone are large enough', onStage(async ({ page }) => {
  const small = await page.evaluate(() =>
    [...document.querySelectorAll('.bar button, .bar a, .bar select, .tabs button')]
      .map((element) => ({ name: element.textContent.trim(), box: element.getBoundingClientRect() }))
      .filter(({ box }) => box.width > 0 && (box.width < 36 || box.height < 36))
      .map(({ name }) => name),
  );
  assert.deepEqual(small, []);
}, phone));

test('every control has a name, and the keyboard reaches all of them', onStage(async ({ page }) => {
  await page.locator('.light summary').first().click();
  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll('button, select, input:not([type=file]), a[href]')]
      .filter((element) => element.checkVisibility())
      .filter((element) => {
        const label = element.getAttribute('aria-label') ?? '';
        const labels = 'labels' in element && element.labels ? [...element.labels].map(({ textContent }) => textContent).join('') : '';
        return !(label || labels.trim() || element.textContent.trim());
      })
      .map((element) => element.outerHTML),
  );
  assert.deepEqual(nameless, []);
  const expected = await page.evaluate(() =>
    [...document.querySelectorAll('button, select, input, a[href], summary')].filter(
      (element) => element.checkVisibility() && !element.matches(':disabled') && !element.closest('details:not([open]) > :not(summary)'),
    ).length,
  );
  await page.evaluate(() => document.body.focus());
  const seen = new Set();
  for (let i = 0; i < expected + 10; i += 1) {
    await page.keyboard.press('Tab');
    seen.add(
      await page.evaluate(() => {
        const active = document.activeElement;
        active.dataset.tabStop ??= String(Math.random());
        return `${active.tagName} ${active.dataset.tabStop}`;
      }),
    );
  }
  assert.ok([...seen].some((tag) => tag.startsWith('SURFELCAST-VIEW')), 'the view too');
  assert.ok(seen.size >= expected, `reached ${seen.size} of ${expected}`);
}));

for (const colorScheme of ['light', 'dark']) {
  test(`text has sufficient contrast in ${colorScheme}`, onStage(
    async ({ page }) => {
      assert.deepEqual(await poorContrast(page, '#sheet *, .bar *'), []);
    },
    { context: { colorScheme } },
  ));
}
