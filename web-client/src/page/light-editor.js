/**
 * One light of the list: a row that expands to its controls.
 */

import { h } from './dom.js';
import { slider, vector } from './fields.js';
import { colorOf, directionOf, hexOf, logScale, skyAngles } from './quantities.js';

/** @typedef {import('../protocol/types.js').Light} Light */

const KINDS = { point: 'Point', spot: 'Spot', directional: 'Sun' };
const INTENSITY = logScale(1e-3, 1e6, 900);
const MOST_INTENSITY = 1e9;

export class LightEditor {
  /** @type {Light} */
  #light;
  /** @type {{ set: (light: Light) => void }[]} */
  #fields = [];

  /**
   * @param {Light} light
   * @param {object} options
   * @param {(light: Light, done: boolean) => void} options.changed
   * @param {(id: number) => void} options.removed
   * @param {() => import('../protocol/types.js').Vec3} options.focus point the camera looks at
   * @param {() => number} options.step metres per dragged pixel
   */
  constructor(light, { changed, removed, focus, step }) {
    this.#light = light;
    this.changed = changed;
    this.name = h('span', { className: 'name' });
    this.swatch = h('input', {
      type: 'color',
      className: 'swatch',
      oninput: () => this.#edit({ color: colorOf(this.swatch.value) }, false),
      onchange: () => this.#edit({ color: colorOf(this.swatch.value) }, true),
    });
    this.enabled = h('input', {
      type: 'checkbox',
      className: 'switch',
      role: 'switch',
      onchange: () => this.#edit({ enabled: this.enabled.checked }, true),
    });
    const directional = light.kind === 'directional';
    const controls = h('div', { className: 'controls' });
    this.#add(controls, (current) => current.intensity, slider({
      label: 'Intensity',
      unit: directional ? 'W/m²' : 'W/sr',
      range: { min: 0, max: 900, step: 1 },
      bounds: { min: 0, max: MOST_INTENSITY },
      scale: INTENSITY,
      changed: (intensity, done) => this.#edit({ intensity }, done),
    }));
    if (light.kind !== 'point') this.#addDirection(controls);
    if (light.kind === 'spot') this.#addCone(controls);
    if (!directional) {
      const position = vector({ label: 'Position', step, changed: (value, done) => this.#edit({ position: value }, done) });
      controls.append(position.element);
      this.#fields.push({ set: (current) => position.set(current.position) });
    }
    controls.append(
      h(
        'div',
        { className: 'actions' },
        directional
          ? undefined
          : h('button', { type: 'button', className: 'quiet', textContent: 'Move to target', title: 'Moves the light to the point that the camera looks at', onclick: () => this.#edit({ position: focus() }, true) }),
        h('button', { type: 'button', className: 'quiet danger', textContent: 'Remove', onclick: () => removed(light.id) }),
      ),
    );
    this.details = h(
      'details',
      {},
      h('summary', {}, this.name, h('span', { className: 'kind' }, KINDS[light.kind] ?? light.kind)),
      controls,
    );
    /** The row itself. */
    this.element = h('li', { className: 'light' }, this.swatch, this.details, this.enabled);
    this.update(light);
  }

  /**
   * Shows the state of the server.
   * @param {Light} light
   */
  update(light) {
    this.#light = light;
    this.name.textContent = light.name || `Light ${light.id}`;
    this.element.classList.toggle('off', !light.enabled);
    this.enabled.checked = light.enabled;
    this.enabled.ariaLabel = `${this.name.textContent} on`;
    this.swatch.value = hexOf(light.color);
    this.swatch.ariaLabel = `Colour of ${this.name.textContent}`;
    for (const field of this.#fields) field.set(light);
  }

  /** @param {boolean} open */
  open(open = true) {
    this.details.open = open;
  }

  /** @param {HTMLElement} controls */
  #addDirection(controls) {
    /** @param {'azimuth' | 'elevation'} name @param {number} degrees @param {boolean} done */
    const aim = (name, degrees, done) =>
      this.#edit({ direction: directionOf({ ...skyAngles(this.#light.direction), [name]: degrees }) }, done);
    this.#add(controls, (light) => skyAngles(light.direction).azimuth, slider({
      label: 'Azimuth',
      unit: '°',
      decimals: 1,
      range: { min: 0, max: 360, step: 1 },
      bounds: { min: 0, max: 360 },
      changed: (degrees, done) => aim('azimuth', degrees, done),
    }));
    this.#add(controls, (light) => skyAngles(light.direction).elevation, slider({
      label: 'Elevation',
      unit: '°',
      decimals: 1,
      // At the zenith the azimuth is undefined.
      range: { min: -89.5, max: 89.5, step: 0.5 },
      bounds: { min: -89.5, max: 89.5 },
      changed: (degrees, done) => aim('elevation', degrees, done),
    }));
  }

  /** @param {HTMLElement} controls */
  #addCone(controls) {
    const cone = () => this.#light.cone_deg ?? /** @type {[number, number]} */ ([0, 45]);
    this.#add(controls, () => cone()[1], slider({
      label: 'Cone',
      unit: '°',
      decimals: 1,
      range: { min: 1, max: 90, step: 0.5 },
      bounds: { min: 1, max: 90 },
      changed: (outer, done) => this.#edit({ cone_deg: [Math.min(cone()[0], outer), outer] }, done),
    }));
    this.#add(controls, () => cone()[0], slider({
      label: 'Core',
      unit: '°',
      decimals: 1,
      range: { min: 0, max: 90, step: 0.5 },
      bounds: { min: 0, max: 90 },
      changed: (inner, done) => this.#edit({ cone_deg: [inner, Math.max(inner, cone()[1])] }, done),
    }));
  }

  /**
   * @param {HTMLElement} controls
   * @param {(light: Light) => number} read
   * @param {import('./fields.js').Field} field
   */
  #add(controls, read, field) {
    controls.append(field.element);
    this.#fields.push({ set: (light) => field.set(read(light)) });
  }

  /**
   * @param {Partial<Light>} change
   * @param {boolean} done
   */
  #edit(change, done) {
    this.#light = { ...this.#light, ...change };
    this.changed(this.#light, done);
    if (done) this.update(this.#light);
  }
}
