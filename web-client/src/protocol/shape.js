/**
 * Checks of parsed JSON: every field that the client reads must be present, of its type and finite.
 *
 * A shape takes a value and its path and returns a description of the first fault, or nothing.
 */

/** @typedef {(value: unknown, path: string) => string | undefined} Shape */

/** @type {Shape} */
export const number = (value, path) =>
  typeof value === 'number' && Number.isFinite(value) ? undefined : `${path} is not a finite number`;

/** @type {Shape} */
export const string = (value, path) => (typeof value === 'string' ? undefined : `${path} is not a string`);

/** @type {Shape} */
export const boolean = (value, path) => (typeof value === 'boolean' ? undefined : `${path} is not true or false`);

/**
 * Accepts an absent field and null.
 * @param {Shape} shape
 * @returns {Shape}
 */
export const optional = (shape) => (value, path) =>
  value === undefined || value === null ? undefined : shape(value, path);

/**
 * @param {Shape} shape
 * @param {number} [length] exact length, if it is fixed
 * @returns {Shape}
 */
export const list = (shape, length) => (value, path) => {
  if (!Array.isArray(value)) return `${path} is not a list`;
  if (length !== undefined && value.length !== length) return `${path} has ${value.length} entries, expected ${length}`;
  for (let i = 0; i < value.length; i += 1) {
    const wrong = shape(value[i], `${path}[${i}]`);
    if (wrong) return wrong;
  }
  return undefined;
};

/**
 * An object with at least these fields; others are ignored, so that a newer server can add some.
 * @param {Record<string, Shape>} fields
 * @returns {Shape}
 */
export const object = (fields) => (value, path) => {
  if (typeof value !== 'object' || value === null || Array.isArray(value)) return `${path} is not an object`;
  for (const [name, shape] of Object.entries(fields)) {
    const wrong = shape(/** @type {Record<string, unknown>} */ (value)[name], path ? `${path}.${name}` : name);
    if (wrong) return wrong;
  }
  return undefined;
};
