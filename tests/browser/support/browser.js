/**
 * Chromium for the tests: the one named by CHROMIUM, or Debian's.
 */

import { chromium } from 'playwright-core';

const FLAGS = [
  '--no-sandbox',
  '--disable-gpu',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];

export function launch() {
  return chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', headless: true, args: FLAGS });
}

/** Time limit of every wait: a busy machine is slow, and only a failure waits this long. */
export const PATIENCE_MS = 60_000;

/**
 * Waits until a condition holds, and names the one that did not.
 * @template T
 * @param {string} what
 * @param {() => T | Promise<T>} probe truthy when it holds
 * @param {number} [limitMs]
 * @returns {Promise<NonNullable<T>>}
 */
export async function until(what, probe, limitMs = PATIENCE_MS) {
  const end = Date.now() + limitMs;
  for (;;) {
    const value = await probe();
    if (value) return value;
    if (Date.now() > end) throw new Error(`waited ${limitMs} ms for: ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 25));
  }
}

/** Colour of the view's canvas at a fraction of its size. */
export function colorAt(page, x, y) {
  return page.evaluate(
    ([fx, fy]) => {
      const { canvas } = document.querySelector('surfelcast-view');
      const at = [Math.floor(canvas.width * fx), Math.floor(canvas.height * fy)];
      return [...canvas.getContext('2d').getImageData(at[0], at[1], 1, 1).data.slice(0, 3)];
    },
    [x, y],
  );
}
