/**
 * Settings of the view: technique, output, exposure, resolution, viewpoints; warnings of the import. Techniques and
 * outputs are enumerated from their descriptors in the welcome.
 */

import { h } from './dom.js';
import { choice, slider } from './fields.js';
import { evOf, factorOf } from './quantities.js';
import { TechniqueSettings } from './technique-settings.js';

/** The choice for no output. */
const RADIANCE = { value: '', label: 'Radiance' };

const RESOLUTIONS = [
  { value: '1', label: 'Full' },
  { value: '0.75', label: 'Three quarters' },
  { value: '0.5', label: 'Half' },
  { value: '0.25', label: 'Quarter' },
];

export class ViewPanel {
  /**
   * @param {HTMLElement} host
   * @param {import('../view/surfelcast-view.js').SurfelcastView} view
   */
  constructor(host, view) {
    this.view = view;
    this.technique = choice({
      label: 'Technique',
      changed: (technique) => {
        view.setView({ technique });
        this.#showTechnique();
        if (this.view.output !== undefined && this.output.value === RADIANCE.value) view.setView({ aov: null });
      },
    });
    this.summary = h('p', { className: 'hint' });
    this.settings = new TechniqueSettings();
    this.output = choice({
      label: 'Show',
      changed: (id) => {
        view.setView({ aov: id || null });
        this.#showOutput();
      },
    });
    this.meaning = h('p', { className: 'hint' });
    this.inspect = h('button', {
      type: 'button',
      textContent: 'Inspect',
      'aria-pressed': 'false',
      title: 'Click a point of the image to see what lights it',
      onclick: () => {
        view.inspecting = !view.inspecting;
      },
    });
    this.exposure = slider({
      label: 'Exposure',
      unit: 'EV',
      decimals: 2,
      range: { min: -10, max: 10, step: 0.1 },
      bounds: { min: -19, max: 19 },
      changed: (ev) => view.setView({ exposure: factorOf(ev) }),
    });
    this.resolution = choice({ label: 'Resolution', changed: (value) => view.setAttribute('resolution', value) });
    this.resolution.set(RESOLUTIONS, view.getAttribute('resolution') ?? '1');
    this.viewpoints = h('div', { className: 'viewpoints', role: 'group', 'aria-label': 'Viewpoints' });
    this.warnings = h('details', { className: 'warnings', hidden: true });
    host.append(
      this.technique.element,
      this.summary,
      this.settings.element,
      this.output.element,
      this.meaning,
      h('div', { className: 'field stack' }, h('span', { className: 'label' }, 'Inspection'), this.inspect),
      this.exposure.element,
      this.resolution.element,
      h('div', { className: 'field stack' }, h('span', { className: 'label' }, 'Viewpoints'), this.viewpoints),
      this.warnings,
    );
  }

  /** @param {import('../protocol/types.js').Welcome} welcome */
  update(welcome) {
    this.welcome = welcome;
    this.technique.set(
      welcome.techniques.map(({ id, label }) => ({ value: id, label })),
      this.view.technique ?? welcome.techniques[0]?.id ?? '',
    );
    this.#showTechnique();
    this.exposure.set(evOf(this.view.exposure));
    const { rig } = this.view;
    /** @param {string} key @param {string} name @param {() => void} go */
    const button = (key, name, go) =>
      h('button', { type: 'button', title: `${name} (key ${key})`, onclick: go }, h('kbd', {}, key), h('span', {}, name));
    this.viewpoints.replaceChildren(
      button('0', 'Whole scene', () => rig.goToPreset(0)),
      ...welcome.cameras.slice(0, 9).map(({ name }, index) => button(String(index + 1), name, () => rig.goToPreset(index + 1))),
    );
    this.#warn(welcome.warnings);
  }

  /** @param {boolean} on whether the inspect mode is on */
  inspecting(on) {
    this.inspect.ariaPressed = String(on);
  }

  /** Shows what belongs to the chosen technique: summary, settings, outputs. */
  #showTechnique() {
    const technique = this.welcome?.techniques.find(({ id }) => id === this.technique.value);
    this.summary.textContent = technique?.summary ?? '';
    this.settings.show(technique);
    const outputs = (this.welcome?.outputs ?? []).filter((output) => (output.technique ?? technique?.id) === technique?.id);
    const chosen = outputs.some(({ id }) => id === this.view.output) ? this.view.output : undefined;
    this.output.set([RADIANCE, ...outputs.map(({ id, label }) => ({ value: id, label }))], chosen ?? RADIANCE.value);
    this.#showOutput();
  }

  #showOutput() {
    this.meaning.textContent = this.welcome?.outputs?.find(({ id }) => id === this.output.value)?.help ?? '';
  }

  /** @param {string[]} warnings */
  #warn(warnings) {
    this.warnings.hidden = warnings.length === 0;
    const title = warnings.length === 1 ? '1 note from the import' : `${warnings.length} notes from the import`;
    this.warnings.replaceChildren(h('summary', {}, title), h('ul', {}, ...warnings.map((text) => h('li', {}, text))));
  }
}
