import assert from 'node:assert/strict';
import test from 'node:test';
import { Connection } from '../src/connection/connection.js';
import { delayMs } from '../src/connection/backoff.js';
import { json } from './support/fixtures.js';
import { FakeClock, FakeWire, welcome } from './support/fakes.js';

function setUp() {
  const clock = new FakeClock();
  const wire = new FakeWire();
  const states = [];
  const messages = [];
  const frames = [];
  const problems = [];
  const connection = new Connection({
    url: '/v1/sessions/s/stream',
    client: 'test/1',
    caps: { codecs: ['webp', 'jpeg', 'png'], dpr: 2, reduced_motion: false },
    open: wire.open,
    clock,
    handlers: {
      onState: (state) => states.push(state),
      onMessage: (message) => messages.push(message),
      onFrame: (frame) => frames.push(frame),
      onProblem: (error) => problems.push(error.message),
    },
  });
  const greet = (token) => {
    wire.last.handlers.onOpen();
    wire.last.handlers.onText(JSON.stringify(welcome(token)));
  };
  return { clock, wire, states, messages, frames, problems, connection, greet };
}

test('says hello first, and nothing else before the welcome', () => {
  const { wire, connection, greet, states } = setUp();
  connection.start();
  assert.equal(wire.last.subprotocol, 'surfelcast.v1.json');
  wire.last.handlers.onOpen();
  assert.equal(connection.send({ t: 'still', view: 0 }), false);
  assert.equal(wire.last.sent.length, 1);
  const [hello] = wire.last.sent;
  assert.equal(hello.t, 'hello');
  assert.deepEqual(hello.v, [1]);
  assert.equal('resume' in hello, false);
  const golden = json('client_messages.json').filter(({ t }) => t === 'hello');
  const known = new Set(golden.flatMap((message) => Object.keys(message)));
  for (const key of Object.keys(hello)) assert.ok(known.has(key), `hello.${key} is in the golden messages`);
  greet();
  assert.equal(connection.send({ t: 'still', view: 0 }), true);
  assert.deepEqual(states.map(({ kind }) => kind), ['connecting', 'live']);
});

test('comes back with the newest token after the wire broke', () => {
  const { clock, wire, connection, greet, states } = setUp();
  connection.start();
  greet('first');
  clock.advance(10_000);
  wire.last.handlers.onClose(1006, '');
  assert.equal(states.at(-1).kind, 'waiting');
  assert.equal(wire.opened.length, 1);
  clock.advance(500);
  assert.equal(wire.opened.length, 2);
  wire.last.handlers.onOpen();
  assert.equal(wire.last.sent[0].resume, 'first');
  wire.last.handlers.onText(JSON.stringify(welcome('second')));
  wire.last.handlers.onClose(1012, '');
  clock.advance(2000);
  wire.last.handlers.onOpen();
  assert.equal(wire.last.sent[0].resume, 'second');
});

test('waits longer and longer, and starts afresh after a healthy connection', () => {
  const { clock, wire, connection, greet, states } = setUp();
  clock.chance = 0;
  connection.start();
  const waits = [];
  for (let i = 0; i < 9; i += 1) {
    wire.last.handlers.onClose(1006, '');
    waits.push(states.at(-1).retryAt - clock.now());
    clock.advance(waits.at(-1));
  }
  assert.deepEqual(waits, [500, 1000, 2000, 4000, 8000, 16_000, 30_000, 30_000, 30_000]);
  greet();
  clock.advance(6000);
  wire.last.handlers.onClose(1006, '');
  assert.equal(states.at(-1).retryAt - clock.now(), 500);
});

test('a server that welcomes and drops at once is not hammered', () => {
  const { clock, wire, connection, greet, states } = setUp();
  clock.chance = 0;
  connection.start();
  const waits = [];
  for (let i = 0; i < 4; i += 1) {
    greet();
    wire.last.handlers.onClose(1006, '');
    waits.push(states.at(-1).retryAt - clock.now());
    clock.advance(waits.at(-1));
  }
  assert.deepEqual(waits, [500, 1000, 2000, 4000]);
});

test('a full server is asked less often', () => {
  for (const code of [1013, 4503]) {
    const { clock, wire, connection, states } = setUp();
    connection.start();
    wire.last.handlers.onOpen();
    wire.last.handlers.onClose(code, '');
    assert.equal(states.at(-1).last.kind, 'full');
    assert.equal(states.at(-1).retryAt - clock.now(), 5000);
  }
});

test('stops where trying again is pointless, until asked', () => {
  const { clock, wire, connection, greet, states } = setUp();
  connection.start();
  greet();
  wire.last.handlers.onClose(4409, '');
  clock.advance(600_000);
  assert.equal(wire.opened.length, 1);
  assert.deepEqual([states.at(-1).kind, states.at(-1).last.kind], ['stopped', 'superseded']);
  connection.retryNow();
  wire.last.handlers.onOpen();
  assert.equal(wire.opened.length, 2);
  assert.equal(wire.last.sent[0].resume, 'token-1');
});

test('a session that is gone takes its token with it', () => {
  const { wire, connection, greet } = setUp();
  connection.start();
  greet();
  wire.last.handlers.onClose(4404, '');
  connection.retryNow();
  wire.last.handlers.onOpen();
  assert.equal('resume' in wire.last.sent[0], false);
});

test('answers pings, and gives up on a peer that fell silent', () => {
  const { clock, wire, connection, greet, states } = setUp();
  connection.start();
  greet();
  for (let i = 0; i < 10; i += 1) {
    clock.advance(15_000);
    wire.last.handlers.onText('{"t":"ping","ts":7}');
    assert.deepEqual(wire.last.sent.at(-1), { t: 'pong', ts: 7 });
  }
  assert.equal(states.at(-1).kind, 'live');
  clock.advance(34_999);
  assert.equal(states.at(-1).kind, 'live');
  const silent = wire.last;
  clock.advance(1);
  assert.equal(silent.closed, true);
  assert.equal(states.at(-1).kind, 'waiting');
});

test('gives up on a server that opens and never welcomes', () => {
  const { clock, wire, connection, states } = setUp();
  connection.start();
  wire.last.handlers.onOpen();
  clock.advance(10_000);
  assert.equal(wire.last.closed, true);
  assert.equal(states.at(-1).kind, 'waiting');
});

test('a malformed message is reported and the connection stays', () => {
  const { wire, connection, greet, problems, messages } = setUp();
  connection.start();
  greet();
  wire.last.handlers.onText('{"t":"picked","position":"here"}');
  wire.last.handlers.onText('{"t":"unheard-of"}');
  assert.deepEqual(problems, ['picked.position is not a list']);
  assert.equal(messages.length, 1);
  assert.ok(connection.isLive);
});

test('an idle connection keeps one timer', () => {
  const { clock, connection, greet } = setUp();
  connection.start();
  greet();
  assert.equal(clock.waiting, 1);
  connection.stop();
  assert.equal(clock.waiting, 0);
});

test('delays are jittered within half and never below half a second', () => {
  assert.equal(delayMs(3, 0), 4000);
  assert.equal(delayMs(3, 0.999999), 2000);
  assert.equal(delayMs(0, 0.9), 500);
  assert.equal(delayMs(1000, 0), 30_000);
  assert.equal(delayMs(0, 0, 5000), 5000);
});
