/**
 * What lights a point of the picture: the cache's values there and the surfels behind them. Shown while the view's
 * inspect mode is on.
 */

import { h } from './dom.js';
import { count, metres, percent, significant } from './format.js';

const ROWS = /** @type {const} */ ({
  position: ['Position', 'm'],
  normal: ['Normal', ''],
  coverage: ['Coverage', ''],
  trust: ['Trust', ''],
  light: ['B', ''],
  direct: ['B, direct', ''],
  indirect: ['B, bounced', ''],
});

const HINT = 'Click a point of the picture to see which surfels light it.';
const NOTHING = 'No surfels here: nothing was hit, or this session has not shown the surfel technique yet.';

/** @typedef {import('../protocol/messages.js').Inspection} Inspection */
/** @typedef {import('../protocol/messages.js').Vec3} Vec3 */

/** @param {readonly number[]} values */
const several = (values) => values.map((value) => significant(value, 3)).join('  ');

export class InspectorPanel {
  /** @type {Inspection | undefined} */
  #inspection;
  /** @type {Partial<Record<keyof typeof ROWS, HTMLElement>>} */
  #values = {};
  /** What stands in the status line while nothing is asked. */
  #status = HINT;

  /**
   * @param {HTMLElement} section hidden while the mode is off; its content goes into its `.inspector`
   * @param {import('../view/surfelcast-view.js').SurfelcastView} view
   * @param {object} options
   * @param {import('./toast.js').Toasts} options.toasts
   * @param {() => void} options.reveal brings the panel into sight
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
    const middle = h('button', { type: 'button', className: 'quiet', textContent: 'Middle of the picture', onclick: () => view.inspect(0.5, 0.5) });
    this.found = h('div', { className: 'found', hidden: true }, figures, this.table);
    this.host.append(this.status, this.found, h('div', { className: 'actions' }, middle, this.copy));
    // Ahead of the sheet, which would close on the same key.
    document.addEventListener('keydown', (event) => this.#escape(event), { capture: true });
    this.mode({ on: view.inspecting, waiting: false });
  }

  /**
   * The mode was switched, or a question went out or came back.
   * @param {{ on: boolean, waiting: boolean }} mode
   */
  mode({ on, waiting }) {
    if (!on) this.clear();
    this.section.hidden = !on;
    this.host.classList.toggle('waiting', waiting);
    this.#say(waiting ? 'Looking…' : this.#status);
  }

  /** @param {{ inspection?: Inspection | null, refusal?: string }} answer */
  show({ inspection, refusal }) {
    this.#inspection = inspection ?? undefined;
    this.found.hidden = !inspection;
    this.copy.disabled = !inspection;
    if (inspection) this.#fill(inspection);
    this.#status = refusal ?? (inspection ? summary(inspection) : NOTHING);
    this.#say(this.#status);
    this.reveal();
    this.section.scrollIntoView({ block: 'nearest' });
  }

  /** Another scene, or the end of the mode. */
  clear() {
    this.#inspection = undefined;
    this.#status = HINT;
    this.found.hidden = true;
    this.copy.disabled = true;
    this.#say(HINT);
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
    else this.toasts.show('The browser did not let the page copy.', 'error');
  }

  /** @param {KeyboardEvent} event */
  #escape(event) {
    if (event.key !== 'Escape' || !this.view.inspecting) return;
    // Flying and dialogs end on the same key, and come first.
    if (this.view.flight.mode || document.querySelector('dialog[open]')) return;
    event.preventDefault();
    event.stopPropagation();
    this.view.inspecting = false;
  }

  /** @param {string} text */
  #say(text) {
    if (this.status.textContent !== text) this.status.textContent = text;
  }
}

/** @param {Inspection} inspection */
function summary({ contributions: { length } }) {
  if (length === 0) return 'No surfel lights this point yet.';
  return length === 1 ? '1 surfel lights this point.' : `${length} surfels light this point.`;
}

/**
 * Puts text on the clipboard. Pages that did not come over TLS or from this machine have no clipboard of the newer kind.
 * @param {string} text
 * @returns {Promise<boolean>} whether it is there now
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
