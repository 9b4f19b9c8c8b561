/**
 * Writes the screenshots of the page in docs/: desktop and phone, light and dark, from the real server.
 *
 *   node docs-images.js [FOLDER]
 */

import { mkdir, mkdtemp, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { launch } from './support/browser.js';
import { startServer } from './support/real-server.js';

const PAGES = [
  { name: 'page-desktop', width: 1440, height: 900, colorScheme: 'light' },
  { name: 'page-desktop-dark', width: 1440, height: 900, colorScheme: 'dark' },
  { name: 'page-phone', width: 390, height: 844, colorScheme: 'dark' },
];
/** Samples per pixel: enough for an image without visible noise, few enough for a software device. */
const SAMPLES = Number(process.env.SAMPLES ?? 128);
const CONVERGE_MS = 900_000;

const folder = process.argv[2] ?? fileURLToPath(new URL('../../docs', import.meta.url));
await mkdir(folder, { recursive: true });
const data = await mkdtemp(join(tmpdir(), 'surfelcast-images-'));
const server = await startServer({ data });
const browser = await launch();
try {
  for (const { name, width, height, colorScheme } of PAGES) {
    const page = await browser.newPage({ viewport: { width, height }, colorScheme, reducedMotion: 'reduce' });
    await page.goto(`${server.address}/?max_spp=${SAMPLES}`);
    await page.locator('#hud[data-state=converged]').waitFor({ timeout: CONVERGE_MS });
    await page.screenshot({ path: join(folder, `${name}.jpg`), type: 'jpeg', quality: 85 });
    await page.close();
    console.log(join(folder, `${name}.jpg`));
  }
} finally {
  await browser.close();
  await server.kill();
  await rm(data, { recursive: true, force: true });
}
