/**
 * The settings of a technique as its descriptors state them: value, accepted values and meaning; a preset shows its own
 * values. For reference: render requests set them by name.
 */

import { h } from './dom.js';
import { choice } from './fields.js';
import { field } from './format.js';

/** @typedef {import('../protocol/types.js').TechniqueInfo} TechniqueInfo */
/** @typedef {import('../protocol/types.js').SettingInfo} SettingInfo */

/** The choice that is no preset. */
const DEFAULTS = { value: '', label: 'Defaults' };

export class TechniqueSettings {
  /** @type {TechniqueInfo | undefined} */
  #technique;

  constructor() {
    this.summary = h('summary');
    this.preset = choice({ label: 'Preset', changed: () => this.#fill() });
    this.rows = h('dl', { className: 'figures settings' });
    /** Hidden for a technique without settings. */
    this.element = h(
      'details',
      { hidden: true },
      this.summary,
      h('p', { className: 'empty', textContent: 'A render request sets these by name.' }),
      this.preset.element,
      this.rows,
    );
  }

  /** @param {TechniqueInfo | undefined} technique */
  show(technique) {
    this.#technique = technique;
    const { settings = [], presets = [] } = technique ?? {};
    this.element.hidden = settings.length === 0;
    this.summary.textContent = settings.length === 1 ? '1 setting' : `${settings.length} settings`;
    this.preset.element.hidden = presets.length === 0;
    this.preset.set([DEFAULTS, ...presets.map(({ id }) => ({ value: id, label: id }))], DEFAULTS.value);
    this.#fill();
  }

  #fill() {
    const { settings = [], presets = [] } = this.#technique ?? {};
    const values = presets.find(({ id }) => id === this.preset.value)?.values ?? {};
    this.rows.replaceChildren(
      ...settings.map((setting) =>
        h(
          'div',
          { className: setting.id in values ? 'changed' : '' },
          h('dt', {}, setting.label, ' ', h('code', {}, setting.id)),
          h('dd', {}, valueText(setting, values[setting.id] ?? setting.default)),
          h('dd', { className: 'help' }, `${acceptedText(setting)}: ${setting.help}`),
        ),
      ),
    );
  }
}

/**
 * @param {SettingInfo} setting
 * @param {unknown} value
 */
export function valueText({ unit = '' }, value) {
  if (typeof value === 'boolean') return value ? 'on' : 'off';
  if (typeof value === 'number') return unit ? `${field(value)} ${unit}` : field(value);
  return String(value);
}

/**
 * The values that a setting accepts.
 * @param {SettingInfo} setting
 */
export function acceptedText(setting) {
  if (setting.kind === 'switch') return 'on or off';
  if (setting.kind === 'choice') return (setting.names ?? []).join(', ');
  const range = (setting.range ?? []).map(field).join(' to ');
  return setting.is_integer ? `${range}, whole` : range;
}
