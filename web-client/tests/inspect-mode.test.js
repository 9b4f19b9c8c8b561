import assert from 'node:assert/strict';
import test from 'node:test';
import { InspectMode } from '../src/view/inspect-mode.js';

function setUp({ isLive = true } = {}) {
  const sent = [];
  const changes = [];
  const marks = [];
  const mode = new InspectMode({
    send: (point) => (isLive ? sent.push(point) : undefined),
    changed: (state) => changes.push(state),
    mark: (point) => marks.push(point),
  });
  return { mode, sent, changes, marks };
}

const at = (x) => ({ x, y: 0.5 });

test('points are requested only while the mode is on', () => {
  const { mode, sent, changes } = setUp();
  mode.request(at(0.1));
  assert.deepEqual([sent, changes], [[], []]);
  mode.set(true);
  mode.set(true);
  mode.request(at(0.2));
  assert.deepEqual(sent, [at(0.2)]);
  assert.deepEqual(changes, [{ on: true, waiting: false }, { on: true, waiting: true }]);
  assert.equal(mode.onAnswer(1), 'newest');
  assert.deepEqual(changes.at(-1), { on: true, waiting: false });
});

test('one request at a time, then the newest of the points meanwhile', () => {
  const { mode, sent, marks } = setUp();
  mode.set(true);
  for (const x of [0.1, 0.2, 0.3]) mode.request(at(x));
  assert.deepEqual(sent, [at(0.1)]);
  assert.deepEqual(marks.at(-1), at(0.3));
  assert.equal(mode.onAnswer(1), 'stale', 'a newer point is requested');
  assert.deepEqual(sent, [at(0.1), at(0.3)]);
  assert.equal(mode.onAnswer(2), 'newest');
  assert.equal(mode.onAnswer(2), 'other', 'answered already');
});

test('answers to other requests are left alone', () => {
  const { mode } = setUp();
  mode.set(true);
  mode.request(at(0.1));
  for (const re of [undefined, null, 7]) assert.equal(mode.onAnswer(re), 'other');
  assert.equal(mode.onAnswer(1), 'newest');
});

test('leaving the mode, or losing the server, drops the request', () => {
  for (const end of [(mode) => mode.set(false), (mode) => mode.onDisconnect()]) {
    const { mode, changes, marks } = setUp();
    mode.set(true);
    mode.request(at(0.1));
    mode.request(at(0.2));
    end(mode);
    assert.equal(changes.at(-1).waiting, false);
    assert.equal(marks.at(-1), undefined);
    assert.equal(mode.onAnswer(1), 'other');
  }
});

test('a request that could not be sent is not waited for', () => {
  const { mode, changes, marks } = setUp({ isLive: false });
  mode.set(true);
  mode.request(at(0.1));
  assert.deepEqual([changes.at(-1), marks.at(-1)], [{ on: true, waiting: false }, undefined]);
});

test('a moved camera removes the mark', () => {
  const { mode, marks } = setUp();
  mode.set(true);
  mode.request(at(0.1));
  mode.onCameraMove();
  assert.equal(marks.at(-1), undefined);
});
