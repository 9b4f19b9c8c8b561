import assert from 'node:assert/strict';
import test from 'node:test';
import { basis, between, distance, dolly, fly, focus, frame, look, orbit, pan, spokenDirection } from '../src/view/camera.js';
import { add, dot, length, normalize, scale, subtract } from '../src/view/vector.js';

const front = { eye: [0, 0, 4], target: [0, 0, 0], up: [0, 1, 0], vfov_deg: 90 };

function near(actual, expected, tolerance = 1e-9) {
  assert.ok(length(subtract(actual, expected)) <= tolerance, `${actual} is not ${expected}`);
}

test('orbiting keeps the distance and the target, and turns the right way', () => {
  near(orbit(front, Math.PI / 2, 0).eye, [4, 0, 0]);
  near(orbit(front, 0, Math.PI / 4).eye, [0, 4 * Math.SQRT1_2, 4 * Math.SQRT1_2]);
  let pose = { ...front, eye: [1, 2, 3], target: [-1, 0.5, 0.2] };
  const before = distance(pose);
  for (let i = 0; i < 1000; i += 1) pose = orbit(pose, 0.37, 0.11 * (i % 2 ? 1 : -1));
  assert.ok(Math.abs(distance(pose) - before) < 1e-9);
  near(pose.target, [-1, 0.5, 0.2]);
});

test('orbiting stops at the poles and comes back from them', () => {
  let pose = front;
  for (let i = 0; i < 100; i += 1) pose = orbit(pose, 0, 0.3);
  assert.ok(pose.eye[1] < 4 && pose.eye[1] > 3.99);
  assert.ok(pose.eye[2] > 0, 'it never tips over');
  const back = orbit(pose, 0, -Math.PI / 4);
  assert.ok(back.eye[1] < 3 && back.eye[2] > 2);
});

test('orbiting turns about the up axis of the pose, not always Y', () => {
  const zUp = { ...front, eye: [4, 0, 0], up: [0, 0, 1] };
  near(orbit(zUp, Math.PI / 2, 0).eye, [0, 4, 0]);
  near(orbit(zUp, 0, Math.PI / 4).eye, [4 * Math.SQRT1_2, 0, 4 * Math.SQRT1_2]);
});

test('looking keeps the eye; left is left and up is up', () => {
  const left = look(front, Math.PI / 2, 0);
  near(left.eye, front.eye);
  near(left.target, [-4, 0, 4]);
  assert.ok(look(front, 0, 0.2).target[1] > 0);
});

test('panning moves the point at the target with the pointer', () => {
  // 90° at distance 4 shows a height of 8.
  const moved = pan(front, 0.25, 0.5);
  near(moved.target, [2, 4, 0]);
  near(moved.eye, [2, 4, 4]);
});

test('dollying keeps the direction and stops before the target', () => {
  near(dolly(front, 0.5, 0.1).eye, [0, 0, 2]);
  near(dolly(front, 1e-9, 0.1).eye, [0, 0, 0.1]);
});

test('flying moves eye and target together', () => {
  const moved = fly(front, [1, 2, 3]);
  near(moved.eye, [1, 2, 1]);
  near(moved.target, [1, 2, -3]);
});

test('focus changes the target only', () => {
  const focused = focus(front, [1, 1, 1]);
  near(focused.target, [1, 1, 1]);
  near(focused.eye, front.eye);
});

test('framing shows the whole sphere', () => {
  for (const vfov of [10, 45, 90, 170]) {
    const pose = frame([1, 2, 3], 5, { ...front, vfov_deg: vfov });
    const half = (Math.min(vfov, 150) * Math.PI) / 360;
    assert.ok(distance(pose) * Math.sin(half) >= 5 - 1e-9, `at ${vfov}°`);
    near(pose.target, [1, 2, 3]);
  }
});

test('the basis is orthonormal even looking along the up axis', () => {
  for (const eye of [[0, 4, 0], [0, -4, 0], [3, 2, 1]]) {
    const { right, up, forward } = basis({ ...front, eye });
    for (const axis of [right, up, forward]) assert.ok(Math.abs(length(axis) - 1) < 1e-9);
    for (const [a, b] of [[right, up], [up, forward], [forward, right]]) assert.ok(Math.abs(dot(a, b)) < 1e-9);
  }
});

test('a degenerate pose yields no NaN', () => {
  const point = { ...front, eye: [1, 1, 1], target: [1, 1, 1], up: [0, 0, 0] };
  for (const pose of [orbit(point, 1, 1), pan(point, 1, 1), dolly(point, 2, 0.1), fly(point, [1, 1, 1]), look(point, 1, 1)]) {
    assert.ok([...pose.eye, ...pose.target].every(Number.isFinite));
  }
});

test('a glide begins and ends exactly', () => {
  const to = orbit(front, 1, 0.3);
  assert.equal(between(front, to, 1), to);
  near(between(front, to, 0).eye, front.eye);
});

test('directions in words', () => {
  const from = (x, y, z) => spokenDirection({ ...front, eye: [x, y, z] });
  assert.equal(from(0, 0, 4), 'front');
  assert.equal(from(0, 0, -4), 'back');
  assert.equal(from(4, 0, 0), 'right');
  assert.equal(from(3, 3, 3), 'upper front right');
  assert.equal(from(-3, -3, -3), 'lower back left');
  assert.equal(from(0, 4, 0.01), 'top');
});

test('vectors without direction fall back', () => {
  near(normalize([0, 0, 0]), [0, 1, 0]);
  near(add(scale([1, 2, 3], 2), [1, 1, 1]), [3, 5, 7]);
});
