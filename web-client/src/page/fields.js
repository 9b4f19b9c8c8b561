/**
 * Form fields of the panels. Each tells `move` while it is dragged and `end` when it is let go.
 */

import { h } from './dom.js';
import { field } from './format.js';

let nextId = 0;
const newId = () => `field-${(nextId += 1)}`;

/**
 * @typedef {object} Field
 * @property {HTMLElement} element
 * @property {(value: number) => void} set shows a value without telling anyone
 */

/**
 * Slider with a number beside it.
 * @param {object} options
 * @param {string} options.label
 * @param {string} [options.unit]
 * @param {{ min: number, max: number, step: number }} options.range of the slider's positions
 * @param {{ min: number, max: number }} options.bounds of the value
 * @param {{ value: (position: number) => number, position: (value: number) => number }} [options.scale] linear if absent
 * @param {number} [options.decimals] shown at most; five significant digits if absent
 * @param {(value: number, done: boolean) => void} options.changed
 * @returns {Field}
 */
export function slider({ label, unit, range, bounds, scale, decimals, changed }) {
  const id = newId();
  const toValue = scale?.value ?? ((position) => position);
  const toPosition = scale?.position ?? ((value) => value);
  /** @param {number} value */
  const show = (value) => {
    number.value = decimals === undefined ? field(value) : String(Number(value.toFixed(decimals)));
  };
  const fill = () => bar.style.setProperty('--fill', `${(100 * (bar.valueAsNumber - range.min)) / (range.max - range.min)}%`);
  const number = h('input', {
    id,
    type: 'number',
    step: 'any',
    min: bounds.min,
    max: bounds.max,
    inputMode: 'decimal',
    onchange: () => {
      const value = Number(number.value);
      if (number.value === '' || !Number.isFinite(value)) return;
      const kept = Math.min(bounds.max, Math.max(bounds.min, value));
      set(kept);
      changed(kept, true);
    },
  });
  const bar = h('input', {
    type: 'range',
    ...range,
    'aria-label': label,
    oninput: () => {
      show(toValue(bar.valueAsNumber));
      fill();
      changed(toValue(bar.valueAsNumber), false);
    },
    onchange: () => changed(toValue(bar.valueAsNumber), true),
  });
  /** @param {number} value */
  function set(value) {
    show(value);
    bar.value = String(toPosition(value));
    fill();
  }
  const element = h(
    'div',
    { className: 'field' },
    h('label', { htmlFor: id }, label, unit ? h('span', { className: 'unit' }, unit) : undefined),
    bar,
    number,
  );
  return { element, set };
}

/**
 * Three numbers. The letter before each can be dragged sideways, or moved with the arrow keys.
 * @param {object} options
 * @param {string} options.label
 * @param {() => number} options.step metres that one pixel of dragging moves
 * @param {(value: import('../protocol/messages.js').Vec3, done: boolean) => void} options.changed
 */
export function vector({ label, step, changed }) {
  /** @type {import('../protocol/messages.js').Vec3} */
  let value = [0, 0, 0];
  const axes = ['X', 'Y', 'Z'].map((name, axis) => {
    let dragged = false;
    /** @param {number} by @param {boolean} done */
    const nudge = (by, done) => {
      value = /** @type {typeof value} */ (value.map((part, i) => (i === axis ? part + by : part)));
      input.value = field(/** @type {number} */ (value[axis]));
      changed(value, done);
    };
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
        nudge(event.movementX * step(), false);
      },
      onlostpointercapture: () => {
        if (dragged) nudge(0, true);
        dragged = false;
      },
      onkeydown: (/** @type {KeyboardEvent} */ event) => {
        const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
        if (way === undefined) return;
        event.preventDefault();
        nudge(way * step() * (event.shiftKey ? 50 : 10), true);
      },
    });
    const input = h('input', {
      type: 'number',
      step: 'any',
      inputMode: 'decimal',
      'aria-label': `${label} ${name}`,
      onchange: () => {
        const typed = Number(input.value);
        if (input.value !== '' && Number.isFinite(typed)) nudge(typed - /** @type {number} */ (value[axis]), true);
      },
    });
    return { handle, input };
  });
  const element = h(
    'div',
    { className: 'field vector', role: 'group', 'aria-label': label },
    h('span', { className: 'label' }, label, h('span', { className: 'unit' }, 'm')),
    h('div', { className: 'axes' }, ...axes.flatMap(({ handle, input }) => [h('div', { className: 'axis' }, handle, input)])),
  );
  return {
    element,
    /** @param {import('../protocol/messages.js').Vec3} next */
    set(next) {
      value = next;
      axes.forEach(({ input }, axis) => {
        input.value = field(/** @type {number} */ (next[axis]));
      });
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
