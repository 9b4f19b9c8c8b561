/**
 * The JSON of every HTTP resource, refusals included, and the welcome of a stream, held against a golden record.
 *
 * What a device, a clock or chance decides is replaced by its type, so the record is the same on every machine. After
 * an intended change: `SURFELCAST_GOLDEN=record node --test resources.spec.js`, and the difference goes into the
 * commit.
 */

import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { mkdtemp, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import WebSocket from 'ws';
import { startServer } from './support/real-server.js';

const RECORD = fileURLToPath(new URL('../golden/resources.json', import.meta.url));

/** Fields whose values belong to a device, a clock or chance. */
const VARYING = new Set([
  'conn', 'created', 'device', 'driver', 'backend', 'expires', 'gpu_ms', 'memory_bytes', 'memory_budget_bytes', 'mse_tonemapped',
  'memory_used_bytes', 'passes', 'rays', 'rel_mse', 'render_secs', 'request_id', 'resume_token', 'rmse_high', 'rmse_low', 'rmse_tonemapped',
  'server_ms', 'setup_secs', 'std_error', 'time_secs', 'trace_id', 'uptime_secs',
]);
/** Headers that are part of the interface. Dates, lengths and ids of requests are not. */
const HEADERS = ['accept-patch', 'allow', 'cache-control', 'content-disposition', 'content-type', 'location', 'preference-applied', 'retry-after', 'vary'];

/** @type {Awaited<ReturnType<typeof startServer>>} */
let server;
let data = '';

before(async () => {
  data = await mkdtemp(join(tmpdir(), 'surfelcast-golden-'));
  server = await startServer({ data });
});

after(async () => {
  await server?.kill();
  if (data) await rm(data, { recursive: true, force: true });
});

/** A value in which varying numbers and texts are replaced by their type, and ids of renders by a word. */
function steady(value, key = '') {
  if (VARYING.has(key)) return value === null ? null : `<${Array.isArray(value) ? 'array' : typeof value}>`;
  if (Array.isArray(value)) return value.map((item) => steady(item));
  if (value && typeof value === 'object') {
    return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, steady(item, name)]));
  }
  return typeof value === 'string' ? steadyText(value) : value;
}

const steadyText = (text) => text.replaceAll(server.address, '<address>').replace(/\/v1\/renders\/[0-9a-z_-]{8,}/g, '/v1/renders/<id>')
  .replace(/^[0-9a-f]{16,40}$|^r[0-9a-z]{8,}$/, '<id>');

async function exchange(method, path, { headers = {}, body } = {}) {
  const answer = await fetch(server.address + path, { method, headers, body });
  const text = await answer.text();
  const kept = Object.fromEntries(HEADERS.filter((name) => answer.headers.has(name)).map((name) => [name, steadyText(answer.headers.get(name))]));
  const type = answer.headers.get('content-type') ?? '';
  const isJson = /json/.test(type);
  const json = isJson ? JSON.parse(text) : undefined;
  const shown = isJson ? steady(json) : `<${type.split(';')[0] || 'empty'}>`;
  return { record: { status: answer.status, headers: kept, body: shown }, json, answer };
}

async function welcome(session) {
  const socket = new WebSocket(`${server.address.replace('http', 'ws')}/v1/sessions/${session}/stream`, 'surfelcast.v1.json', { origin: server.address });
  try {
    return await new Promise((resolve, reject) => {
      socket.once('error', reject);
      socket.once('close', (code) => reject(new Error(`closed with ${code}`)));
      socket.once('unexpected-response', (_, response) => reject(new Error(`status ${response.statusCode}`)));
      socket.once('open', () => socket.send(JSON.stringify({
        t: 'hello', v: [1], client: 'golden', caps: { codecs: ['jpeg'], dpr: 1, reduced_motion: false },
      })));
      socket.on('message', (payload, isBinary) => !isBinary && resolve(JSON.parse(String(payload))));
    });
  } finally {
    socket.terminate();
  }
}

test('every resource answers as recorded', async () => {
  const found = {};
  const keep = async (name, method, path, options) => {
    const { record, json, answer } = await exchange(method, path, options);
    found[`${name}: ${method} ${steadyText(path)}`] = record;
    return { json, answer };
  };
  const post = (body, headers = {}) => ({ headers: { 'content-type': 'application/json', ...headers }, body: typeof body === 'string' ? body : JSON.stringify(body) });

  for (const path of ['/', '/docs', '/healthz', '/readyz', '/version', '/v1/openapi.json', '/nothing']) await keep('page', 'GET', path);
  const metrics = await (await fetch(`${server.address}/metrics`)).text();
  found['names of metrics'] = [...metrics.matchAll(/^# TYPE (\S+) (\S+)$/gm)].map(([, name, kind]) => `${name} ${kind}`).sort();

  const { json: listed } = await keep('scenes', 'GET', '/v1/scenes');
  const { id: cornell, session } = listed.scenes.find((scene) => scene.name === 'cornell_box');
  await keep('scene', 'GET', `/v1/scenes/${cornell}`);
  await keep('unknown scene', 'GET', `/v1/scenes/sha256:${'0'.repeat(64)}`);
  await keep('delete a built-in scene', 'DELETE', `/v1/scenes/${cornell}`);
  await keep('no scene in it', 'POST', '/v1/scenes', { headers: { 'content-type': 'model/gltf-binary' }, body: 'not a glb' });
  await keep('unknown kind of scene', 'POST', '/v1/scenes', { headers: { 'content-type': 'text/plain' }, body: 'x' });
  await keep('wrong method', 'PUT', '/v1/scenes');

  const small = { scene: cornell, width: 48, height: 36, samples_per_pixel: 2 };
  const made = await keep('render', 'POST', '/v1/renders', post(small));
  const location = made.answer.headers.get('location');
  if (location) {
    for (const end = Date.now() + 300_000; Date.now() < end; ) {
      const { json } = await exchange('GET', location);
      if (!['queued', 'running'].includes(json.status)) break;
      await new Promise((resolve) => setTimeout(resolve, 200));
    }
    await keep('finished render', 'GET', location);
    await keep('its image', 'GET', `${location}/image`, { headers: { accept: 'image/png' } });
    await keep('its image as nothing known', 'GET', `${location}/image`, { headers: { accept: 'text/html' } });
    await keep('cancel a finished render', 'POST', `${location}/cancel`);
    await keep('delete a render', 'DELETE', location);
  }
  await keep('render at once', 'POST', '/v1/renders', post({ ...small, seed: 3 }, { prefer: 'wait=120', accept: 'image/png' }));
  await keep('unknown render', 'GET', '/v1/renders/000000000000');
  const refused = {
    'not JSON': '{',
    'no scene': { width: 8, height: 8 },
    'unknown field': { ...small, colour: 1 },
    'unknown scene': { ...small, scene: `sha256:${'0'.repeat(64)}` },
    'unknown camera': { ...small, camera_name: 'nowhere' },
    'no width': { ...small, width: 0 },
    'too wide': { ...small, width: 1e6 },
    'no samples': { ...small, samples_per_pixel: 0 },
    'text for samples': { ...small, samples_per_pixel: 'many' },
    'unknown technique': { ...small, technique: 'magic' },
    'preset without settings': { ...small, technique: 'path', preset: 'high' },
    'unknown preset': { ...small, technique: 'surfel', preset: 'best' },
    'unknown reconstruction': { ...small, technique: 'surfel', reconstruction: 'magic' },
    'unknown output': { ...small, aov: 'magic' },
    'unknown materials': { ...small, materials: 'wood' },
    'error of zero': { ...small, max_error: 0 },
    'negative seed': { ...small, seed: -1 },
    'exposure not a number': { ...small, exposure: 'bright' },
    'camera without target': { ...small, camera: { position: [0, 0, 0] } },
    'camera twice': { ...small, camera_name: 'x', camera: { position: [0, 0, 3], target: [0, 0, 0], up: [0, 1, 0], vfov_deg: 40 } },
  };
  for (const [name, body] of Object.entries(refused)) await keep(`refused, ${name}`, 'POST', '/v1/renders', post(body));
  await keep('refused, kind of body', 'POST', '/v1/renders', { headers: { 'content-type': 'text/plain' }, body: '{}' });
  await keep('refused, kind of answer', 'POST', '/v1/renders', post(small, { accept: 'text/html', prefer: 'wait=60' }));

  await keep('stream without an upgrade', 'GET', `/v1/sessions/${session}/stream`);
  found.welcome = steady(await welcome(session));

  const text = `${JSON.stringify(found, null, 1)}\n`;
  if (process.env.SURFELCAST_GOLDEN === 'record') {
    writeFileSync(RECORD, text);
    return;
  }
  const golden = JSON.parse(readFileSync(RECORD, 'utf8'));
  for (const name of new Set([...Object.keys(golden), ...Object.keys(found)])) assert.deepEqual(found[name], golden[name], name);
});
