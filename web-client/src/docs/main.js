/**
 * A readable page of `/v1/openapi.json`: one section an operation, then the schemas.
 */

import { byId, h } from '../page/dom.js';
import { anchorOf, describeSchema, inline, prose, table, typeOf } from './schema.js';

/** @typedef {Record<string, any>} Json */

const METHODS = ['get', 'post', 'put', 'patch', 'delete', 'head', 'options'];

async function show() {
  const reference = byId('reference');
  try {
    const response = await fetch('/v1/openapi.json', { headers: { accept: 'application/json' } });
    if (!response.ok) throw new Error(`the server answered with status ${response.status}`);
    render(reference, byId('contents'), await response.json());
  } catch (error) {
    const { message } = /** @type {Error} */ (error);
    reference.replaceChildren(h('p', { role: 'alert' }, `The description could not be loaded: ${message}. Reload the page to try again.`));
  }
}

/**
 * @param {HTMLElement} reference
 * @param {HTMLElement} contents
 * @param {Json} document_
 */
function render(reference, contents, document_) {
  const operations = operationsOf(document_);
  const schemas = Object.entries(/** @type {Record<string, Json>} */ (document_['components']?.schemas ?? {}));
  reference.replaceChildren(
    h('h1', {}, document_['info']?.title ?? 'HTTP interface', ' ', h('small', {}, document_['info']?.version ?? '')),
    ...(document_['info']?.description ? [prose(document_['info'].description)] : []),
    ...operations.map(describeOperation),
    ...(schemas.length ? [h('h2', { id: 'schemas' }, 'Schemas'), ...schemas.map(([name, schema]) => describeSchema(name, schema))] : []),
  );
  contents.replaceChildren(
    h('ul', {}, ...operations.map(({ id, method, path }) => h('li', {}, h('a', { href: `#${id}` }, badge(method), h('span', {}, path))))),
    ...(schemas.length
      ? [h('h2', {}, 'Schemas'), h('ul', {}, ...schemas.map(([name]) => h('li', {}, h('a', { href: `#${anchorOf(name)}` }, name))))]
      : []),
  );
  // The target of a link into the page exists only after rendering.
  if (location.hash) document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
}

/**
 * @param {Json} document_
 * @returns {{ id: string, method: string, path: string, operation: Json, parameters: Json[] }[]}
 */
function operationsOf(document_) {
  const paths = Object.entries(/** @type {Record<string, Json>} */ (document_['paths'] ?? {}));
  // The versioned API first; pages and probes of the server follow.
  /** @param {[string, Json]} entry */
  const versioned = ([path]) => (/^\/v\d+\//.test(path) ? 0 : 1);
  return paths.toSorted((a, b) => versioned(a) - versioned(b)).flatMap(([path, item]) =>
    METHODS.filter((method) => item[method]).map((method) => ({
      id: `${method}-${path.replace(/[^a-zA-Z0-9]+/g, '-').replace(/^-|-$/g, '')}`,
      method,
      path,
      operation: item[method],
      parameters: [...(item['parameters'] ?? []), ...(item[method].parameters ?? [])],
    })),
  );
}

/** @param {ReturnType<typeof operationsOf>[number]} entry */
function describeOperation({ id, method, path, operation, parameters }) {
  const section = h(
    'section',
    { className: 'operation', id },
    h('h2', {}, badge(method), h('code', {}, path)),
    operation['summary'] ? h('p', { className: 'summary' }, ...inline(operation['summary'])) : undefined,
    operation['description'] && operation['description'] !== operation['summary'] ? prose(operation['description']) : undefined,
  );
  if (parameters.length > 0) {
    const rows = parameters.map((parameter) =>
      h(
        'tr',
        {},
        h('th', { scope: 'row' }, h('code', {}, parameter['name']), parameter['required'] ? undefined : h('span', { className: 'optional' }, 'optional')),
        h('td', {}, `${parameter['in']}, `, typeOf(parameter['schema'])),
        h('td', {}, ...inline(parameter['description'])),
      ),
    );
    section.append(h('h3', {}, 'Parameters'), table(['Name', 'Where and type', 'Meaning'], rows));
  }
  if (operation['requestBody']) {
    section.append(h('h3', {}, 'Body'));
    if (operation['requestBody'].description) section.append(prose(operation['requestBody'].description));
    section.append(h('ul', { className: 'bodies' }, ...bodies(operation['requestBody'].content)));
  }
  const rows = Object.entries(/** @type {Record<string, Json>} */ (operation['responses'] ?? {})).map(([status, response]) =>
    h(
      'tr',
      {},
      h('th', { scope: 'row' }, h('code', { className: `status s${status[0]}` }, status)),
      h('td', {}, ...inline(response['description'] || (status.startsWith('2') ? 'Done' : '')), ...headers(response['headers'])),
      h('td', {}, h('ul', { className: 'bodies' }, ...bodies(response['content']))),
    ),
  );
  section.append(h('h3', {}, 'Answers'), h('div', { className: 'answers' }, table(['Status', 'When', 'Body'], rows)));
  return section;
}

/** @param {Record<string, Json> | undefined} content */
const bodies = (content) =>
  Object.entries(content ?? {}).map(([type, { schema }]) =>
    // OpenAPI describes a file as a list of numbers; "bytes" reads better.
    h('li', {}, h('code', {}, type), ' ', !schema ? '' : /json|text|form/.test(type) ? typeOf(schema) : 'bytes'),
  );

/** @param {Record<string, Json> | undefined} named */
const headers = (named) =>
  Object.entries(named ?? {}).map(([name, header]) => h('div', { className: 'header' }, h('code', {}, name), ' ', ...inline(header['description'])));

/** @param {string} method */
const badge = (method) => h('span', { className: `method ${method}` }, method.toUpperCase());

void show();
