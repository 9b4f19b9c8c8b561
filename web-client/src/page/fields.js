/**
 * Form fields of the panels. Each reports values with `done` false while it is dragged, and true when it is released.
 */

import { h } from './dom.js';
import { field } from './format.js';

let nextId = 0;
const newId = () => `field-${(nextId += 1)}`;

/**
 * @typedef {object} Field
 * @property {HTMLElement} element
 * @property {(value: number) => void} set shows a value without reporting it
 */

/**
 * Field for a number. While it is edited, until Enter, Escape or loss of focus, it keeps the text of the user; a value
 * that `set` gives meanwhile, such as another person's edit, is shown after that.
 * @param {Record<string, unknown>} properties
 * @param {(value: number) => string} text
 * @param {(value: number) => void} commit called with the number that was typed
 */
function numberInput(properties, text, commit) {
  let value = 0;
  let isEdited = false;
  const edit = () => (isEdited = true);
  const show = () => {
    isEdited = false;
    input.value = text(value);
  };
  /** @param {KeyboardEvent} event */
  const escape = (event) => {
    if (event.key !== 'Escape' || input.value === text(value)) return;
    event.stopPropagation();
    show();
  };
  const input = h('input', {
    type: 'number',
    step: 'any',
    inputMode: 'decimal',
    ...properties,
    onfocus: () => {
      edit();
      // In the capture phase, before the inspector and the sheet, which the same key closes.
      addEventListener('keydown', escape, true);
    },
    oninput: edit,
    onchange: () => {
      isEdited = false;
      const typed = input.valueAsNumber;
      if (Number.isFinite(typed) && input.value !== text(value)) commit(typed);
      else show();
    },
    onblur: () => {
      removeEventListener('keydown', escape, true);
      // The window may have lost the focus instead.
      if (document.activeElement !== input) show();
    },
  });
  /** @param {number} next */
  const set = (next) => {
    value = next;
    // A field that is disabled loses the focus without an event.
    if (!isEdited || document.activeElement !== input) show();
  };
  return { input, set };
}

/**
 * Slider with a number field.
 * @param {object} options
 * @param {string} options.label
 * @param {string} [options.unit]
 * @param {{ min: number, max: number, step: number }} options.range of the slider's positions
 * @param {{ min: number, max: number }} options.bounds of the value
 * @param {{ value: (position: number) => number, position: (value: number) => number }} [options.scale]
 *   linear if absent
 * @param {number} [options.decimals] shown at most; five significant digits if absent
 * @param {(value: number, done: boolean) => void} options.changed
 * @returns {Field}
 */
export function slider({ label, unit, range, bounds, scale, decimals, changed }) {
  const id = newId();
  const toValue = scale?.value ?? ((position) => position);
  const toPosition = scale?.position ?? ((value) => value);
  const fill = () => bar.style.setProperty('--fill', `${(100 * (bar.valueAsNumber - range.min)) / (range.max - range.min)}%`);
  const number = numberInput(
    { id, ...bounds },
    (value) => (decimals === undefined ? field(value) : String(Number(value.toFixed(decimals)))),
    (typed) => {
      const kept = Math.min(bounds.max, Math.max(bounds.min, typed));
      set(kept);
      changed(kept, true);
    },
  );
  const bar = h('input', {
    type: 'range',
    ...range,
    'aria-label': label,
    oninput: () => {
      number.set(toValue(bar.valueAsNumber));
      fill();
      changed(toValue(bar.valueAsNumber), false);
    },
    onchange: () => changed(toValue(bar.valueAsNumber), true),
  });
  /** @param {number} value */
  function set(value) {
    number.set(value);
    bar.value = String(toPosition(value));
    fill();
  }
  const element = h(
    'div',
    { className: 'field' },
    h('label', { htmlFor: id }, label, unit ? h('span', { className: 'unit' }, unit) : undefined),
    bar,
    number.input,
  );
  return { element, set };
}

/**
 * Three numbers. The letter before each is a handle to drag sideways or to move with the arrow keys.
 * @param {object} options
 * @param {string} options.label
 * @param {() => number} options.step metres per dragged pixel
 * @param {(value: import('../protocol/types.js').Vec3, done: boolean) => void} options.changed
 */
export function vector({ label, step, changed }) {
  /** @type {import('../protocol/types.js').Vec3} */
  let value = [0, 0, 0];
  const axes = ['X', 'Y', 'Z'].map((name, axis) => {
    let dragged = false;
    /** @param {number} part @param {boolean} done */
    const put = (part, done) => {
      value = /** @type {typeof value} */ (value.with(axis, part));
      number.set(part);
      changed(value, done);
    };
    /** @param {number} by @param {boolean} done */
    const shift = (by, done) => put(/** @type {number} */ (value[axis]) + by, done);
    const number = numberInput({ 'aria-label': `${label} ${name}` }, field, (typed) => put(typed, true));
    const handle = h('button', {
      type: 'button',
      className: `scrub axis-${name.toLowerCase()}`,
      textContent: name,
      title: `Drag sideways to move along ${name}`,
      'aria-label': `Move along ${name}: drag, or arrow keys`,
      onpointerdown: (/** @type {PointerEvent} */ event) => handle.setPointerCapture(event.pointerId),
      onpointermove: (/** @type {PointerEvent} */ event) => {
        if (!handle.hasPointerCapture(event.pointerId) || event.movementX === 0) return;
        dragged = true;
        shift(event.movementX * step(), false);
      },
      onlostpointercapture: () => {
        if (dragged) shift(0, true);
        dragged = false;
      },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        const sign = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
        if (sign === undefined) return;
        event.preventDefault();
        shift(sign * step() * (event.shiftKey ? 50 : 10), true);
      },
    });
    return { handle, number };
  });
  const element = h(
    'div',
    { className: 'field vector', role: 'group', 'aria-label': label },
    h('span', { className: 'label' }, label, h('span', { className: 'unit' }, 'm')),
    h('div', { className: 'axes' }, ...axes.map(({ handle, number }) => h('div', { className: 'axis' }, handle, number.input))),
  );
  return {
    element,
    /** @param {import('../protocol/types.js').Vec3} next */
    set(next) {
      value = next;
      axes.forEach(({ number }, axis) => number.set(/** @type {number} */ (next[axis])));
    },
  };
}

/**
 * A drop-down list.
 * @param {object} options
 * @param {string} options.label
 * @param {(value: string) => void} options.changed
 */
export function choice({ label, changed }) {
  const id = newId();
  const select = h('select', { id, onchange: () => changed(select.value) });
  return {
    element: h('div', { className: 'field choice' }, h('label', { htmlFor: id }, label), select),
    /**
     * @param {{ value: string, label: string }[]} options
     * @param {string} chosen
     */
    set(options, chosen) {
      select.replaceChildren(...options.map(({ value, label: text }) => h('option', { value }, text)));
      select.value = chosen;
      select.disabled = options.length < 2;
    },
    get value() {
      return select.value;
    },
  };
}
