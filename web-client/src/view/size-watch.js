/**
 * Reports the size of an element in CSS pixels: at once, then at most every tenth of a second while it changes.
 */

const THROTTLE_MS = 100;

/**
 * @param {HTMLElement} element
 * @param {(size: { width: number, height: number }) => void} changed
 * @returns {() => void} ends the watch
 */
export function watchSize(element, changed) {
  let last = { width: 0, height: 0 };
  let reportedAt = -Infinity;
  /** @type {number | undefined} */
  let timer;
  const report = () => {
    timer = undefined;
    changed(last);
    reportedAt = performance.now();
  };
  const observer = new ResizeObserver((entries) => {
    const box = entries.at(-1)?.contentRect;
    if (!box || box.width < 1 || box.height < 1) return;
    last = { width: box.width, height: box.height };
    timer ??= window.setTimeout(report, Math.max(0, reportedAt + THROTTLE_MS - performance.now()));
  });
  observer.observe(element);
  return () => {
    observer.disconnect();
    if (timer !== undefined) clearTimeout(timer);
  };
}
