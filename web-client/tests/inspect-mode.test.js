import assert from 'node:assert/strict';
import test from 'node:test';
import { InspectMode } from '../src/view/inspect-mode.js';

function setUp({ heard = true } = {}) {
  const sent = [];
  const changes = [];
  const marks = [];
  const mode = new InspectMode({
    send: (point) => (heard ? sent.push(point) : undefined),
    changed: (state) => changes.push(state),
    mark: (point) => marks.push(point),
  });
  return { mode, sent, changes, marks };
}

const at = (x) => ({ x, y: 0.5 });

test('points mean something only while the mode is on', () => {
  const { mode, sent, changes } = setUp();
  mode.ask(at(0.1));
  assert.deepEqual([sent, changes], [[], []]);
  mode.set(true);
  mode.set(true);
  mode.ask(at(0.2));
  assert.deepEqual(sent, [at(0.2)]);
  assert.deepEqual(changes, [{ on: true, waiting: false }, { on: true, waiting: true }]);
  assert.equal(mode.answered(1), 'newest');
  assert.deepEqual(changes.at(-1), { on: true, waiting: false });
});

test('one question at a time, and of the points meanwhile the newest', () => {
  const { mode, sent, marks } = setUp();
  mode.set(true);
  for (const x of [0.1, 0.2, 0.3]) mode.ask(at(x));
  assert.deepEqual(sent, [at(0.1)]);
  assert.deepEqual(marks.at(-1), at(0.3));
  assert.equal(mode.answered(1), 'stale', 'another point is meant by now');
  assert.deepEqual(sent, [at(0.1), at(0.3)]);
  assert.equal(mode.answered(2), 'newest');
  assert.equal(mode.answered(2), 'other', 'answered already');
});

test('answers to others are left to them', () => {
  const { mode } = setUp();
  mode.set(true);
  mode.ask(at(0.1));
  for (const re of [undefined, null, 7]) assert.equal(mode.answered(re), 'other');
  assert.equal(mode.answered(1), 'newest');
});

test('leaving, or losing the server, forgets the question', () => {
  for (const end of [(mode) => mode.set(false), (mode) => mode.lost()]) {
    const { mode, changes, marks } = setUp();
    mode.set(true);
    mode.ask(at(0.1));
    mode.ask(at(0.2));
    end(mode);
    assert.equal(changes.at(-1).waiting, false);
    assert.equal(marks.at(-1), undefined);
    assert.equal(mode.answered(1), 'other');
  }
});

test('a question that nobody hears is not waited for', () => {
  const { mode, changes, marks } = setUp({ heard: false });
  mode.set(true);
  mode.ask(at(0.1));
  assert.deepEqual([changes.at(-1), marks.at(-1)], [{ on: true, waiting: false }, undefined]);
});

test('a moved camera takes the mark away', () => {
  const { mode, marks } = setUp();
  mode.set(true);
  mode.ask(at(0.1));
  mode.moved();
  assert.equal(marks.at(-1), undefined);
});
