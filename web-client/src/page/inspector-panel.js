/**
 * What lights a point of the image: the values of the cache there and the surfels that contribute. Shown while the
 * view's inspect mode is on.
 */

import { h } from './dom.js';
import { count, metres, percent, significant } from './format.js';

const ROWS = /** @type {const} */ ({
  position: ['Position', 'm'],
  normal: ['Normal', ''],
  coverage: ['Coverage', ''],
  trust: ['Trust', ''],
  light: ['Irradiance / π', ''],
  direct: ['Direct', ''],
  indirect: ['Indirect', ''],
});

const HINT = 'Click a point of the image to see which surfels light it.';
const NOTHING = 'No surfels here: nothing was hit, or this session has not shown the surfel technique yet.';

/** @typedef {import('../protocol/types.js').Inspection} Inspection */
/** @typedef {import('../protocol/types.js').Vec3} Vec3 */

/** @param {readonly number[]} values */
const several = (values) => values.map((value) => significant(value, 3)).join('  ');

export class InspectorPanel {
  /** @type {Inspection | undefined} */
  #inspection;
  /** @type {Partial<Record<keyof typeof ROWS, HTMLElement>>} */
  #values = {};
  /** Text of the status line while no request is open. */
  #status = HINT;

  /**
   * @param {HTMLElement} section hidden while the mode is off; its content goes into its `.inspector`
   * @param {import('../view/surfelcast-view.js').SurfelcastView} view
   * @param {object} options
   * @param {import('./toast.js').Toasts} options.toasts
   * @param {() => void} options.reveal scrolls the panel into view
   */
  constructor(section, view, { toasts, reveal }) {
    this.section = section;
    this.view = view;
    this.toasts = toasts;
    this.reveal = reveal;
    this.host = /** @type {HTMLElement} */ (section.querySelector('.inspector'));
    this.status = h('p', { className: 'empty', role: 'status' });
    const figures = h('dl', { className: 'figures' });
    for (const [key, [label, unit]] of Object.entries(ROWS)) {
      const value = h('dd');
      this.#values[/** @type {keyof typeof ROWS} */ (key)] = value;
      figures.append(h('div', {}, h('dt', {}, label, unit ? h('span', { className: 'unit' }, unit) : undefined), value));
    }
    this.rows = h('tbody');
    const heads = ['Surfel', 'Share', 'Rays', 'Radius', 'Error'].map((head) => h('th', { scope: 'col' }, head));
    this.table = h(
      'div',
      { className: 'surfels', tabIndex: 0, role: 'region', 'aria-label': 'Surfels that light the point, the largest share first' },
      h('table', {}, h('thead', {}, h('tr', {}, ...heads)), this.rows),
    );
    this.copy = h('button', { type: 'button', textContent: 'Copy JSON', onclick: () => void this.#copy() });
    const centre = h('button', { type: 'button', className: 'quiet', textContent: 'Centre of the image', onclick: () => view.inspect(0.5, 0.5) });
    this.found = h('div', { className: 'found', hidden: true }, figures, this.table);
    this.host.append(this.status, this.found, h('div', { className: 'actions' }, centre, this.copy));
    // In the capture phase, before the sheet, which the same key closes.
    document.addEventListener('keydown', (event) => this.#escape(event), { capture: true });
    this.mode({ on: view.inspecting, waiting: false });
  }

  /**
   * The mode was switched, or a request was sent or answered.
   * @param {{ on: boolean, waiting: boolean }} mode
   */
  mode({ on, waiting }) {
    if (!on) this.clear();
    this.section.hidden = !on;
    this.host.classList.toggle('waiting', waiting);
    this.#setStatus(waiting ? 'Waiting for the server…' : this.#status);
  }

  /** @param {{ inspection?: Inspection | null, refusal?: string }} answer */
  show({ inspection, refusal }) {
    this.#inspection = inspection ?? undefined;
    this.found.hidden = !inspection;
    this.copy.disabled = !inspection;
    if (inspection) this.#fill(inspection);
    this.#status = refusal ?? (inspection ? summary(inspection) : NOTHING);
    this.#setStatus(this.#status);
    this.reveal();
    this.section.scrollIntoView({ block: 'nearest' });
  }

  /** For another scene, or the end of the mode. */
  clear() {
    this.#inspection = undefined;
    this.#status = HINT;
    this.found.hidden = true;
    this.copy.disabled = true;
    this.#setStatus(HINT);
  }

  /** @param {Inspection} inspection */
  #fill({ position, normal, coverage, trust, direct, indirect, contributions }) {
    const light = direct.map((part, i) => part + /** @type {number} */ (indirect[i]));
    const texts = {
      position: several(position),
      normal: several(normal),
      coverage: significant(coverage, 3),
      trust: significant(trust, 3),
      light: several(light),
      direct: several(direct),
      indirect: several(indirect),
    };
    for (const [key, text] of Object.entries(texts)) {
      const value = this.#values[/** @type {keyof typeof ROWS} */ (key)];
      if (value) value.textContent = text;
    }
    this.table.hidden = contributions.length === 0;
    this.table.scrollTop = 0;
    this.rows.replaceChildren(
      ...contributions.map((part) =>
        h(
          'tr',
          {},
          h('th', { scope: 'row' }, String(part.id)),
          h('td', {}, percent(part.share)),
          h('td', {}, count(part.ray_count)),
          h('td', {}, metres(part.radius)),
          h('td', {}, significant(part.std_error, 2)),
        ),
      ),
    );
  }

  async #copy() {
    if (!this.#inspection) return;
    const text = JSON.stringify(this.#inspection, undefined, 2);
    const done = await copyText(text);
    if (done) this.toasts.show('The inspection was copied as JSON.');
    else this.toasts.show('The browser refused access to the clipboard.', 'error');
  }

  /** @param {KeyboardEvent} event */
  #escape(event) {
    if (event.key !== 'Escape' || !this.view.inspecting) return;
    // Flying and dialogs end on the same key, and take precedence.
    if (this.view.flight.mode || document.querySelector('dialog[open]')) return;
    event.preventDefault();
    event.stopPropagation();
    this.view.inspecting = false;
  }

  /** @param {string} text */
  #setStatus(text) {
    if (this.status.textContent !== text) this.status.textContent = text;
  }
}

/** @param {Inspection} inspection */
function summary({ contributions: { length } }) {
  if (length === 0) return 'No surfel lights this point yet.';
  return length === 1 ? '1 surfel lights this point.' : `${length} surfels light this point.`;
}

/**
 * Copies text to the clipboard. Outside secure contexts the clipboard API does not exist, and `execCommand` replaces
 * it.
 * @param {string} text
 * @returns {Promise<boolean>} whether it was copied
 */
async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const before = /** @type {HTMLElement | null} */ (document.activeElement);
    const area = h('textarea', { className: 'unseen', value: text, 'aria-hidden': 'true' });
    document.body.append(area);
    area.select();
    const done = document.execCommand('copy');
    area.remove();
    before?.focus();
    return done;
  }
}
