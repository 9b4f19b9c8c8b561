import assert from 'node:assert/strict';
import test from 'node:test';
import { MessageError, parseServerMessage, SUBPROTOCOL, VERSION } from '../src/protocol/messages.js';
import { close, verdictOf } from '../src/protocol/close.js';
import { json, rust } from './support/fixtures.js';

test('every golden server message is understood', () => {
  const golden = json('server_messages.json');
  assert.ok(golden.length > 0);
  for (const message of golden) {
    const parsed = parseServerMessage(JSON.stringify(message));
    assert.equal(parsed?.t, message.t);
  }
});

test('subprotocol and version are those of the Rust side', () => {
  const source = rust('lib.rs');
  assert.ok(source.includes(`"${SUBPROTOCOL}"`));
  assert.match(source, new RegExp(`VERSION: u32 = ${VERSION};`));
});

test('additions of a newer server are ignored', () => {
  assert.equal(parseServerMessage('{"t":"presence","who":[]}'), undefined);
  assert.equal(parseServerMessage('{"t":"toString"}'), undefined);
  assert.equal(parseServerMessage('{"t":"ok","re":1,"later":true}')?.t, 'ok');
});

test('malformed messages are refused by name of the field', () => {
  const golden = (type) => structuredClone(json('server_messages.json').find(({ t }) => t === type));
  const changed = (type, change) => {
    const message = golden(type);
    change(message);
    return JSON.stringify(message);
  };
  const cases = [
    ['{', /not JSON/],
    ['null', /no type/],
    ['[]', /no type/],
    ['{"t":5}', /no type/],
    ['{"t":"ping"}', /ping\.ts is not a finite number/],
    ['{"t":"ping","ts":1e999}', /ping\.ts is not a finite number/],
    ['{"t":"picked","position":[1,2]}', /picked\.position has 2 entries, expected 3/],
    ['{"t":"picked","position":7}', /picked\.position is not a list or null/],
    [changed('lights', ({ lights }) => delete lights[0].name), /lights\.lights\[0\]\.name is not a string/],
    [changed('lights', (message) => (message.lights = {})), /lights\.lights is not a list/],
    [changed('stats', ({ passes }) => (passes[0].ms = null)), /stats\.passes\[0\]\.ms is not a finite number/],
    [changed('welcome', (message) => (message.session = [])), /welcome\.session is not an object/],
    [changed('welcome', (message) => delete message.limits.max_side), /welcome\.limits\.max_side is not a finite number/],
  ];
  for (const [text, reason] of cases) {
    assert.throws(() => parseServerMessage(text), (error) => error instanceof MessageError && reason.test(error.message), text);
  }
});

test('a point without surfels is null, and a server without outputs offers none', () => {
  const golden = json('server_messages.json');
  assert.ok(golden.some(({ t, inspection }) => t === 'inspected' && inspection === null));
  const { outputs, ...older } = golden.find(({ t }) => t === 'welcome');
  assert.ok(outputs.length > 0);
  assert.deepEqual(parseServerMessage(JSON.stringify(older)).outputs, []);
});

test('a light without `enabled` is on', () => {
  const light = { id: 1, name: '', kind: 'point', position: [0, 0, 0], direction: [0, -1, 0], color: [1, 1, 1], intensity: 1 };
  const text = JSON.stringify({ t: 'lights', scene_rev: 1, lights: [light, { ...light, enabled: false }], environment_strength: 1, emissive_strength: 1, has_environment: false });
  assert.deepEqual(parseServerMessage(text).lights.map(({ enabled }) => enabled), [true, false]);
});

test('close codes are those of the Rust side, and each has a text', () => {
  const theirs = Object.fromEntries([...rust('close.rs').matchAll(/pub const (\w+): u16 = (\d+);/g)].map(([, name, code]) => [name, Number(code)]));
  assert.deepEqual({ ...close }, theirs);
  for (const code of Object.values(close)) {
    const { title, detail } = verdictOf(code);
    assert.ok(title.length > 0 && detail.length > 0, String(code));
  }
});

test('only transient failures are retried', () => {
  const retried = Object.entries(close).filter(([, code]) => verdictOf(code).retry).map(([name]) => name);
  assert.deepEqual(retried.sort(), ['GOING_AWAY', 'GPU_LOST', 'NO_CAPACITY', 'RATE', 'RESTART', 'TOO_SLOW', 'TRY_LATER']);
  assert.ok(verdictOf(1006).retry, 'an abnormal closure');
});
