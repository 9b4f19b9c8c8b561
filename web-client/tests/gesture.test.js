import assert from 'node:assert/strict';
import test from 'node:test';
import { Gesture } from '../src/view/gesture.js';
import { Rig } from '../src/view/rig.js';
import { Flight } from '../src/view/flight.js';
import { orbit } from '../src/view/camera.js';
import { FakeClock } from './support/fakes.js';

function setUp() {
  const clock = new FakeClock();
  const sent = [];
  const gesture = new Gesture((value, phase) => sent.push([value, phase]), clock);
  return { clock, sent, gesture };
}

test('moves are merged to one per frame, the newest', () => {
  const { clock, sent, gesture } = setUp();
  for (let i = 0; i < 10; i += 1) {
    gesture.move(i);
    clock.advance(2);
  }
  clock.advance(16);
  gesture.end();
  assert.deepEqual(sent, [[0, 'start'], [7, 'move'], [9, 'move'], [9, 'end']]);
});

test('start and end are never lost, even within one frame', () => {
  const { clock, sent, gesture } = setUp();
  gesture.move('a');
  gesture.move('b');
  gesture.end();
  clock.advance(100);
  assert.deepEqual(sent, [['a', 'start'], ['b', 'end']]);
});

test('a click without movement sends nothing', () => {
  const { clock, sent, gesture } = setUp();
  gesture.end();
  clock.advance(1000);
  assert.deepEqual(sent, []);
  assert.equal(clock.waiting, 0);
});

test('a wheel gesture accumulates and ends after 200 ms of quiet', () => {
  const { clock, sent, gesture } = setUp();
  let sum = 0;
  for (let i = 0; i < 5; i += 1) {
    gesture.burst((sum += 10));
    clock.advance(100);
  }
  assert.ok(gesture.isOpen);
  clock.advance(99);
  assert.ok(gesture.isOpen);
  clock.advance(1);
  assert.deepEqual(sent.at(-1), [50, 'end']);
  assert.equal(sent.filter(([, phase]) => phase === 'end').length, 1);
  assert.equal(clock.waiting, 0);
});

test('a fast display does not exceed the limit on inputs', () => {
  const { clock, sent, gesture } = setUp();
  clock.requestFrame = (run) => clock.setTimeout(run, 1);
  for (let i = 0; i < 1000; i += 1) {
    gesture.move(i);
    clock.advance(1);
  }
  assert.ok(sent.length <= 1000 / 8 + 2, `${sent.length} inputs in a second`);
});

test('a whole gesture replaces what was pending', () => {
  const { clock, sent, gesture } = setUp();
  gesture.move(1);
  gesture.move(2);
  gesture.once(3);
  clock.advance(1000);
  assert.deepEqual(sent, [[1, 'start'], [3, 'end']]);
});

function rigSetUp({ reduced = false } = {}) {
  const clock = new FakeClock();
  const sent = [];
  const rig = new Rig({
    send: (pose, phase) => sent.push({ pose, phase }),
    changed: () => undefined,
    reducedMotion: () => reduced,
    scheduler: clock,
  });
  rig.enterScene({ cameras: [{ name: 'a', pose: rig.pose, exposure: 1 }], center: [0, 0, 0], radius: 2 });
  return { clock, sent, rig };
}

test('the rig rests after a glide, having arrived exactly', () => {
  const { clock, sent, rig } = rigSetUp();
  rig.goToPreset(0);
  clock.advance(2000);
  assert.equal(sent[0].phase, 'start');
  assert.equal(sent.at(-1).phase, 'end');
  assert.deepEqual(sent.at(-1).pose, rig.overview);
  assert.equal(clock.waiting, 0);
});

test('user input cancels a glide', () => {
  const { clock, sent, rig } = rigSetUp();
  rig.goToPreset(0);
  clock.advance(50);
  const caught = orbit(rig.pose, 0.1, 0);
  rig.move(caught);
  clock.advance(1000);
  rig.end();
  assert.deepEqual(sent.at(-1), { pose: caught, phase: 'end' });
  assert.equal(clock.waiting, 0);
});

test('with reduced motion the camera jumps in one input', () => {
  const { clock, sent, rig } = rigSetUp({ reduced: true });
  rig.goToPreset(0);
  clock.advance(2000);
  assert.deepEqual(sent.map(({ phase }) => phase), ['end']);
});

test('moving to the present pose, or to a number without viewpoint, sends nothing', () => {
  const { clock, sent, rig } = rigSetUp();
  const attempts = [
    () => rig.goTo({ ...rig.pose }),
    () => rig.goToPreset(7),
    () => rig.move({ ...rig.pose }),
    () => rig.move({ ...rig.pose, eye: [Number.NaN, 0, 0] }),
  ];
  for (const attempt of attempts) {
    attempt();
    clock.advance(1000);
    assert.deepEqual(sent, [], String(attempt));
  }
});

test('flying runs a loop only while keys are held', () => {
  const { clock, sent, rig } = rigSetUp();
  const flight = new Flight(rig, () => undefined);
  assert.equal(flight.press('KeyW', false), false, 'keys mean nothing outside fly mode');
  flight.setMode(true);
  assert.equal(clock.waiting, 0);
  flight.press('KeyW', false);
  clock.advance(500);
  flight.release('KeyW', false);
  const count = sent.length;
  clock.advance(1000);
  assert.equal(sent.length, count);
  assert.equal(sent.at(-1).phase, 'end');
  assert.equal(clock.waiting, 0);
  const flown = rig.home.eye[2] - rig.pose.eye[2];
  assert.ok(Math.abs(flown - 2 * 0.35 * 0.5) < 0.03, `flew ${flown} m`);
});

test('leaving fly mode stops the flight', () => {
  const { clock, sent, rig } = rigSetUp();
  const flight = new Flight(rig, () => undefined);
  flight.setMode(true);
  flight.press('KeyD', true);
  clock.advance(100);
  flight.setMode(false);
  assert.equal(clock.waiting, 0);
  assert.equal(sent.at(-1).phase, 'end');
});

test('the right button flies only while it is held', () => {
  const { clock, rig } = rigSetUp();
  const flight = new Flight(rig, () => undefined);
  flight.setButton(true);
  assert.equal(flight.looking, false, 'it pans until a key is pressed');
  flight.press('KeyW', false);
  assert.equal(flight.looking, true);
  flight.setButton(false);
  assert.equal(clock.waiting, 0);
});
