/**
 * What lights a point of the image, as the server explains it: figures of the point and the rows behind them. Shown
 * while the view's inspect mode is on.
 */

import { h } from './dom.js';
import { count, metres, percent, significant } from './format.js';

const HINT = 'Click a point of the image to see what lights it.';
const NOTHING = 'Nothing to show here: nothing was hit, or the technique in use does not explain its light.';

/** @typedef {import('../protocol/types.js').Inspection} Inspection */
/** @typedef {import('../protocol/types.js').FieldValue} FieldValue */

/** @param {FieldValue} value */
const figure = (value) => (Array.isArray(value) ? value.map((part) => significant(part, 3)).join('  ') : significant(value, 3));

/**
 * A value of a row, by the unit of its column.
 * @param {FieldValue | undefined} value
 * @param {string | undefined} unit
 */
function cell(value, unit) {
  if (typeof value !== 'number') return value === undefined ? '' : figure(value);
  if (unit === 'share') return percent(value);
  if (unit === 'count') return count(value);
  if (unit === 'm') return metres(value);
  return Number.isInteger(value) ? String(value) : significant(value, 2);
}

export class InspectorPanel {
  /** @type {Inspection | undefined} */
  #inspection;
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
    this.figures = h('dl', { className: 'figures' });
    this.heads = h('tr');
    this.rows = h('tbody');
    this.table = h(
      'div',
      { className: 'contributions', tabIndex: 0, role: 'region', 'aria-label': 'What lights the point, the most important first' },
      h('table', {}, h('thead', {}, this.heads), this.rows),
    );
    this.copy = h('button', { type: 'button', textContent: 'Copy JSON', onclick: () => void this.#copy() });
    const centre = h('button', { type: 'button', className: 'quiet', textContent: 'Centre of the image', onclick: () => view.inspect(0.5, 0.5) });
    this.found = h('div', { className: 'found', hidden: true }, this.figures, this.table);
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
    this.#status = refusal ?? (inspection?.headline ?? NOTHING);
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
  #fill({ position, normal, summary, columns, rows }) {
    const figures = [{ label: 'Position', unit: 'm', value: position }, { label: 'Normal', unit: '', value: normal }, ...summary];
    this.figures.replaceChildren(
      ...figures.map(({ label, unit, value }) =>
        h('div', {}, h('dt', {}, label, unit ? h('span', { className: 'unit' }, unit) : undefined), h('dd', {}, figure(value))),
      ),
    );
    this.table.hidden = rows.length === 0;
    this.table.scrollTop = 0;
    // Vectors and colours are in the copied JSON; the table has room for numbers.
    const shown = columns.flatMap(({ label, unit }, index) => (Array.isArray(rows[0]?.values[index]) ? [] : [{ label, unit, index }]));
    this.heads.replaceChildren(...shown.map(({ label }) => h('th', { scope: 'col' }, label)));
    this.rows.replaceChildren(
      ...rows.map(({ values }) => {
        const texts = shown.map(({ unit, index }) => cell(values[index], unit));
        return h('tr', {}, ...texts.map((text, place) => (place === 0 ? h('th', { scope: 'row' }, text) : h('td', {}, text))));
      }),
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
