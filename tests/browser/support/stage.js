/**
 * A page on a fake server, for one test.
 */

import { after, before } from 'node:test';
import { FakeServer } from './fake-server.js';
import { launch, PATIENCE_MS, until } from './browser.js';

/** @type {import('playwright-core').Browser} */
let browser;

/** Starts the browser of a file of tests, and ends it. */
export function withBrowser() {
  before(async () => {
    browser = await launch();
  });
  after(() => browser?.close());
}

/**
 * Opens the page, runs a test, and checks that the page logged no error.
 * @param {(stage: {
 *   page: import('playwright-core').Page, server: FakeServer, context: import('playwright-core').BrowserContext
 * }) => Promise<void>} run
 * @param {object} [options]
 * @param {import('playwright-core').BrowserContextOptions} [options.context]
 * @param {string} [options.path]
 * @param {boolean} [options.converged] wait until the image has converged
 * @param {(server: FakeServer) => void} [options.prepare]
 * @param {RegExp} [options.allow] console errors that belong to the test
 */
export function onStage(run, { context: contextOptions = {}, path = '/', converged = true, prepare, allow } = {}) {
  return async () => {
    const server = await new FakeServer().start();
    prepare?.(server);
    const context = await browser.newContext({ viewport: { width: 1000, height: 700 }, reducedMotion: 'reduce', ...contextOptions });
    context.setDefaultTimeout(PATIENCE_MS);
    const page = await context.newPage();
    const errors = [];
    page.on('console', (message) => message.type() === 'error' && errors.push(message.text()));
    page.on('pageerror', (error) => errors.push(error.message));
    try {
      await page.goto(server.address + path);
      if (converged) await hasConverged(page);
      await run({ page, server, context });
      const unexpected = errors.filter((text) => !allow?.test(text));
      if (unexpected.length > 0) throw new Error(`the page logged: ${unexpected.join('; ')}`);
    } finally {
      await context.close();
      await server.kill();
    }
  };
}

/** Waits until the page says that the image has converged. */
export const hasConverged = (page) => page.locator('#hud[data-state=converged]').waitFor();

/** Text of the status card; empty while it is hidden. */
export const cardText = (page) =>
  page.evaluate(() => {
    const card = document.querySelector('surfelcast-view').shadowRoot.querySelector('.card');
    return card.hidden ? '' : card.textContent.replace(/\s+/g, ' ').trim();
  });

/** Centre of the view, in CSS pixels of the page. */
export async function centre(page) {
  const box = await page.locator('surfelcast-view').boundingBox();
  return { x: box.x + box.width / 2, y: box.y + box.height / 2, box };
}

export { until };
