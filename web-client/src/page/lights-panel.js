/**
 * The lights of the session: list, add, remove, edit; strength of environment and emissive surfaces.
 */

import { add, mix, normalize, scale, subtract, length } from '../view/vector.js';
import { isAtOrAfter } from '../protocol/serial.js';
import { Gesture } from '../view/gesture.js';
import { h } from './dom.js';
import { slider } from './fields.js';
import { LightEditor } from './light-editor.js';
import { logScale } from './quantities.js';

/** @typedef {import('../protocol/types.js').Light} Light */
/** @typedef {import('../protocol/types.js').LightPatch} LightPatch */
/** @typedef {Extract<import('../protocol/types.js').ServerMessage, { t: 'lights' }>} LightState */

const STRENGTH = logScale(1e-2, 1e2, 400);

export class LightsPanel {
  /** @type {Map<number, LightEditor>} */
  #editors = new Map();
  /**
   * What was edited here last, until a frame contains it: a light's id or the name of a strength.
   * @type {number | string | undefined}
   */
  #editing;
  /** Input number of that edit. */
  #sent = 0;
  /** @type {LightState | undefined} */
  #state;
  /** Whether the next new light was added here and will be expanded. */
  #added = false;
  /** @type {Gesture<LightPatch>} */
  #gesture;

  /**
   * @param {HTMLElement} host
   * @param {import('../view/surfelcast-view.js').SurfelcastView} view
   */
  constructor(host, view) {
    this.view = view;
    this.#gesture = new Gesture((patch, phase) => {
      this.#sent = view.editLights(patch, phase);
    });
    this.list = h('ul', { className: 'lights' });
    this.none = h('p', { className: 'empty', textContent: 'No point, spot or sun lights. Emissive surfaces and the environment light this scene.' });
    /** @param {'point' | 'spot' | 'directional'} kind @param {string} text */
    const adder = (kind, text) => h('button', { type: 'button', textContent: text, 'aria-label': `Add ${text.toLowerCase()} light`, onclick: () => this.#add(kind) });
    this.adders = [adder('point', 'Point'), adder('spot', 'Spot'), adder('directional', 'Sun')];
    this.environment = this.#strength('Environment', 'environment_strength');
    this.emissive = this.#strength('Emission', 'emissive_strength');
    host.append(
      this.list,
      this.none,
      h('div', { className: 'adders', role: 'group', 'aria-label': 'Add a light' }, h('span', { className: 'label' }, 'Add'), ...this.adders),
      h('div', { className: 'controls strengths' }, this.environment.element, this.emissive.element),
    );
  }

  /** @param {LightState} state */
  update(state) {
    this.#state = state;
    const known = new Set(state.lights.map(({ id }) => id));
    for (const [id, editor] of this.#editors) {
      if (known.has(id)) continue;
      editor.element.remove();
      this.#editors.delete(id);
    }
    for (const light of state.lights) this.#show(light);
    this.#added = false;
    this.none.hidden = state.lights.length > 0;
    const full = state.lights.length >= (this.view.welcome?.limits.max_lights ?? Infinity);
    for (const adder of this.adders) adder.disabled = full;
    this.environment.element.hidden = !state.has_environment;
    if (this.#editing !== 'environment_strength') this.environment.set(state.environment_strength);
    if (this.#editing !== 'emissive_strength') this.emissive.set(state.emissive_strength);
  }

  /**
   * A frame contains the last edit, or it was refused: shows the state of the server again.
   * @param {number} [inputSeq] last input that the frame contains
   */
  catchUp(inputSeq = this.#sent) {
    if (this.#editing === undefined || this.#gesture.isOpen || !isAtOrAfter(inputSeq, this.#sent)) return;
    this.#editing = undefined;
    if (this.#state) this.update(this.#state);
  }

  /** Forgets the lights, before those of another session arrive. */
  clear() {
    this.#gesture.abandon();
    this.#editing = undefined;
    this.#state = undefined;
    this.#editors.clear();
    this.list.replaceChildren();
  }

  /** @param {Light} light */
  #show(light) {
    const editor = this.#editors.get(light.id);
    if (editor) {
      // While a light is edited here, the server's echoes are older than the shown value.
      if (this.#editing !== light.id) editor.update(light);
      return;
    }
    const made = new LightEditor(light, {
      changed: (changed, done) => this.#edit(changed.id, { set: changed }, done),
      removed: (id) => this.#edit(id, { remove: id }, true),
      focus: () => this.view.rig.pose.target,
      step: () => this.view.rig.radius / 400,
    });
    this.#editors.set(light.id, made);
    this.list.append(made.element);
    if (this.#added) made.open();
  }

  /**
   * @param {number | string} subject
   * @param {LightPatch} patch
   * @param {boolean} done
   */
  #edit(subject, patch, done) {
    if (this.#editing !== undefined && this.#editing !== subject) this.#gesture.end();
    this.#editing = subject;
    // The final value replaces a pending move.
    if (done) this.#gesture.once(patch);
    else this.#gesture.move(patch);
  }

  /** @param {Light['kind']} kind */
  #add(kind) {
    const { pose } = this.view.rig;
    const distance = length(subtract(pose.eye, pose.target));
    const exposure = this.view.exposure;
    // Between target and eye, nearer to the eye and slightly raised, where no wall or ceiling is in between. The
    // intensity follows the exposure.
    const position = add(mix(pose.target, pose.eye, 0.6), scale(normalize(pose.up), 0.05 * distance));
    const away = length(subtract(position, pose.target));
    const labels = { point: 'Point light', spot: 'Spot light', directional: 'Sun' };
    /** @type {Light} */
    const light = {
      id: 0,
      name: labels[kind],
      kind,
      position,
      direction: kind === 'directional' ? normalize([-0.5, -1, -0.35]) : normalize(subtract(pose.target, position), [0, -1, 0]),
      color: [1, 1, 1],
      intensity: kind === 'directional' ? 3 / exposure : (3 * away * away) / exposure,
      ...(kind === 'spot' && { cone_deg: /** @type {[number, number]} */ ([20, 35]) }),
      enabled: true,
    };
    this.#added = true;
    this.#edit('add', { add: light }, true);
  }

  /**
   * @param {string} label
   * @param {'environment_strength' | 'emissive_strength'} name
   */
  #strength(label, name) {
    return slider({
      label,
      unit: '×',
      range: { min: 0, max: 400, step: 1 },
      bounds: { min: 0, max: 1e6 },
      scale: STRENGTH,
      changed: (value, done) => this.#edit(name, { [name]: value }, done),
    });
  }
}
