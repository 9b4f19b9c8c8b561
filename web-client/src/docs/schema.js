/**
 * JSON Schemas of an OpenAPI document as text and tables.
 */

import { h } from '../page/dom.js';

/** @typedef {Record<string, any>} Schema */

/** @param {string} name */
export const anchorOf = (name) => `schema-${name}`;

/**
 * The type of a value in a few words; named schemas become links.
 * @param {Schema | undefined} schema
 * @returns {HTMLElement}
 */
export function typeOf(schema) {
  const box = h('span', { className: 'type' });
  if (!schema) {
    box.append('anything');
  } else if (typeof schema['$ref'] === 'string') {
    const name = schema['$ref'].split('/').at(-1) ?? '';
    box.append(h('a', { href: `#${anchorOf(name)}` }, name));
  } else if (schema['oneOf'] || schema['anyOf'] || schema['allOf']) {
    const parts = schema['oneOf'] ?? schema['anyOf'] ?? schema['allOf'];
    const word = schema['allOf'] ? ' and ' : ' or ';
    parts.forEach((/** @type {Schema} */ part, /** @type {number} */ i) => box.append(...(i ? [word] : []), typeOf(part)));
  } else if (schema['enum'] || schema['const'] !== undefined) {
    const values = schema['enum'] ?? [schema['const']];
    values.forEach((/** @type {unknown} */ value, /** @type {number} */ i) =>
      box.append(...(i ? [' or '] : []), h('code', {}, JSON.stringify(value))),
    );
  } else if (schema['items'] || schema['prefixItems']) {
    box.append('list of ', typeOf(schema['items'] || schema['prefixItems']?.[0]));
  } else {
    const types = [schema['type'] ?? 'object'].flat().map((type) => (type === 'string' && schema['format'] === 'binary' ? 'bytes' : type));
    box.append(types.join(' or '));
  }
  const bounds = boundsOf(schema);
  if (bounds) box.append(h('span', { className: 'bounds' }, bounds));
  return box;
}

/**
 * A named schema: what it is and its fields.
 * @param {string} name
 * @param {Schema} schema
 */
export function describeSchema(name, schema) {
  const section = h('section', { className: 'schema', id: anchorOf(name) }, h('h3', {}, name));
  if (schema['description']) section.append(prose(schema['description']));
  const variants = schema['oneOf'] ?? schema['anyOf'] ?? schema['allOf'];
  if (schema['properties']) section.append(fieldTable(schema));
  else if (variants) {
    for (const variant of variants) {
      if (variant.properties) {
        if (variant.description) section.append(prose(variant.description));
        section.append(fieldTable(variant));
      } else section.append(h('p', {}, typeOf(variant), ...(variant.description ? [': ', ...inline(variant.description)] : [])));
    }
  } else section.append(h('p', {}, typeOf(schema)));
  return section;
}

/**
 * @param {Schema} schema with properties
 */
export function fieldTable(schema) {
  const required = new Set(schema['required'] ?? []);
  const rows = Object.entries(/** @type {Record<string, Schema>} */ (schema['properties'])).map(([name, property]) =>
    h(
      'tr',
      {},
      h('th', { scope: 'row' }, h('code', {}, name), required.has(name) ? undefined : h('span', { className: 'optional' }, 'optional')),
      h('td', {}, typeOf(property)),
      h('td', {}, ...inline(property['description'])),
    ),
  );
  return table(['Field', 'Type', 'Meaning'], rows);
}

/**
 * @param {string[]} heads
 * @param {HTMLTableRowElement[]} rows
 */
export function table(heads, rows) {
  return h(
    'div',
    { className: 'table' },
    h('table', {}, h('thead', {}, h('tr', {}, ...heads.map((head) => h('th', { scope: 'col' }, head)))), h('tbody', {}, ...rows)),
  );
}

/**
 * Description text: blank lines separate paragraphs, backticks mark code.
 * @param {string} text
 */
export function prose(text) {
  const box = h('div', { className: 'prose' });
  for (const paragraph of text.trim().split(/\n\s*\n/)) box.append(h('p', {}, ...inline(paragraph)));
  return box;
}

/**
 * Text in which backticks mark code.
 * @param {string | undefined} text
 */
export const inline = (text) => (text ?? '').split('`').map((part, i) => (i % 2 === 1 ? h('code', {}, part) : part));

/** @param {Schema | undefined} schema */
function boundsOf(schema) {
  if (!schema) return '';
  const words = [];
  if (schema['minimum'] !== undefined) words.push(`≥ ${schema['minimum']}`);
  if (schema['exclusiveMinimum'] !== undefined) words.push(`> ${schema['exclusiveMinimum']}`);
  if (schema['maximum'] !== undefined) words.push(`≤ ${schema['maximum']}`);
  if (schema['maxLength'] !== undefined) words.push(`at most ${schema['maxLength']} characters`);
  if (schema['minItems'] !== undefined && schema['minItems'] === schema['maxItems']) words.push(`exactly ${schema['minItems']}`);
  else if (schema['maxItems'] !== undefined) words.push(`at most ${schema['maxItems']} entries`);
  if (schema['default'] !== undefined) words.push(`default ${JSON.stringify(schema['default'])}`);
  return words.join(', ');
}
