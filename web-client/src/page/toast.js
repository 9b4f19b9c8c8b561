/**
 * Short messages at the edge of the page: refusals with their reason, confirmations. Announced by screen readers.
 */

import { h } from './dom.js';

const SHOWN_MS = 7000;
/** Most messages at a time; the oldest is removed. */
const MOST = 3;

export class Toasts {
  /** @param {HTMLElement} host with `aria-live` */
  constructor(host) {
    this.host = host;
  }

  /**
   * @param {string} text
   * @param {'info' | 'error'} [kind] errors stay until they are dismissed
   */
  show(text, kind = 'info') {
    const close = h('button', { type: 'button', className: 'dismiss', 'aria-label': 'Dismiss', textContent: '×' });
    const toast = h('div', { className: `toast ${kind}` }, h('span', {}, text), close);
    close.addEventListener('click', () => toast.remove());
    this.host.append(toast);
    while (this.host.childElementCount > MOST) this.host.firstElementChild?.remove();
    if (kind === 'info') setTimeout(() => toast.remove(), SHOWN_MS);
  }
}
