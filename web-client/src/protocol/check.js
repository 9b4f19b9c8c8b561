/**
 * Checks parsed JSON against a schema: every field that the client reads must be present, of its type and finite.
 * Unknown fields are ignored, so that a newer server can add some. Absent fields get their default.
 */

/**
 * The part of JSON Schema that `schema.js` uses.
 * @typedef {object} Schema
 * @property {string} [$ref] name of a definition, after `#/$defs/`
 * @property {string | string[]} [type]
 * @property {Schema[]} [anyOf]
 * @property {Record<string, Schema>} [properties]
 * @property {Schema} [additionalProperties]
 * @property {string[]} [required]
 * @property {Schema} [items]
 * @property {number} [minItems]
 * @property {number} [maxItems]
 * @property {unknown} [default]
 */

/** @type {Record<string, [(value: unknown) => boolean, string]>} */
const TYPES = {
  null: [(value) => value === null, 'null'],
  boolean: [(value) => typeof value === 'boolean', 'true or false'],
  number: [Number.isFinite, 'a finite number'],
  integer: [Number.isFinite, 'a finite number'],
  string: [(value) => typeof value === 'string', 'a string'],
  array: [Array.isArray, 'a list'],
  object: [(value) => typeof value === 'object' && value !== null && !Array.isArray(value), 'an object'],
};

/**
 * The first fault of a value, or nothing.
 * @param {any} value gets the defaults of absent fields
 * @param {Schema} schema
 * @param {string} path of the value
 * @param {Record<string, Schema>} definitions
 * @returns {string | undefined}
 */
export function faultOf(value, schema, path, definitions) {
  const definition = schema.$ref && definitions[schema.$ref.replace('#/$defs/', '')];
  return (
    (definition && faultOf(value, definition, path, definitions)) ||
    (schema.anyOf && faultOfAny(value, schema.anyOf, path, definitions)) ||
    (schema.type && faultOfType(value, [schema.type].flat(), path)) ||
    (Array.isArray(value) && faultOfItems(value, schema, path, definitions)) ||
    (value && typeof value === 'object' && faultOfFields(value, schema, path, definitions)) ||
    undefined
  );
}

/**
 * @param {unknown} value
 * @param {Schema[]} schemas
 * @param {string} path
 * @param {Record<string, Schema>} definitions
 */
function faultOfAny(value, schemas, path, definitions) {
  const faults = schemas.map((schema) => faultOf(value, schema, path, definitions));
  return faults.every(Boolean) ? faults[0] : undefined;
}

/**
 * @param {unknown} value
 * @param {string[]} types
 * @param {string} path
 */
function faultOfType(value, types, path) {
  const known = types.flatMap((type) => (TYPES[type] ? [TYPES[type]] : []));
  if (known.some(([matches]) => matches(value))) return undefined;
  return `${path} is not ${known.map(([, name]) => name).join(' or ')}`;
}

/**
 * @param {unknown[]} list
 * @param {Schema} schema
 * @param {string} path
 * @param {Record<string, Schema>} definitions
 */
function faultOfItems(list, { items, minItems = 0, maxItems = Infinity }, path, definitions) {
  if (list.length < minItems || list.length > maxItems) {
    return `${path} has ${list.length} entries, expected ${minItems === maxItems ? minItems : `${minItems} to ${maxItems}`}`;
  }
  for (const [i, item] of list.entries()) {
    const fault = items && faultOf(item, items, `${path}[${i}]`, definitions);
    if (fault) return fault;
  }
  return undefined;
}

/**
 * @param {Record<string, unknown>} fields
 * @param {Schema} schema
 * @param {string} path
 * @param {Record<string, Schema>} definitions
 */
function faultOfFields(fields, { properties = {}, additionalProperties, required = [] }, path, definitions) {
  for (const [name, schema] of Object.entries(properties)) {
    if (fields[name] === undefined && 'default' in schema) fields[name] = structuredClone(schema.default);
    if (fields[name] === undefined && !required.includes(name)) continue;
    const fault = faultOf(fields[name], schema, `${path}.${name}`, definitions);
    if (fault) return fault;
  }
  for (const [name, value] of additionalProperties ? Object.entries(fields) : []) {
    const fault = name in properties || !additionalProperties ? undefined : faultOf(value, additionalProperties, `${path}.${name}`, definitions);
    if (fault) return fault;
  }
  return undefined;
}
