import assert from 'node:assert/strict';
import test from 'node:test';
import { Connection } from '../src/connection/connection.js';
import { delayMs } from '../src/connection/backoff.js';
import { json } from './support/fixtures.js';
import { FakeClock, FakeTransport, welcome } from './support/fakes.js';

function setUp() {
  const clock = new FakeClock();
  const transport = new FakeTransport();
  const states = [];
  const messages = [];
  const frames = [];
  const problems = [];
  const connection = new Connection({
    url: '/v1/sessions/s/stream',
    client: 'test/1',
    caps: { codecs: ['webp', 'jpeg', 'png'], dpr: 2, reduced_motion: false },
    open: transport.open,
    clock,
    handlers: {
      onState: (state) => states.push(state),
      onMessage: (message) => messages.push(message),
      onFrame: (frame) => frames.push(frame),
      onProblem: (error) => problems.push(error.message),
    },
  });
  const openAndWelcome = (token) => {
    transport.last.handlers.onOpen();
    transport.last.handlers.onText(JSON.stringify(welcome(token)));
  };
  return { clock, transport, states, messages, frames, problems, connection, openAndWelcome };
}

test('says hello first, and nothing else before the welcome', () => {
  const { transport, connection, openAndWelcome, states } = setUp();
  connection.start();
  assert.equal(transport.last.subprotocol, 'surfelcast.v1.json');
  transport.last.handlers.onOpen();
  assert.equal(connection.send({ t: 'still', view: 0 }), false);
  assert.equal(transport.last.sent.length, 1);
  const [hello] = transport.last.sent;
  assert.equal(hello.t, 'hello');
  assert.deepEqual(hello.v, [1]);
  assert.equal('resume' in hello, false);
  const golden = json('client_messages.json').filter(({ t }) => t === 'hello');
  const known = new Set(golden.flatMap((message) => Object.keys(message)));
  for (const key of Object.keys(hello)) assert.ok(known.has(key), `hello.${key} is in the golden messages`);
  openAndWelcome();
  assert.equal(connection.send({ t: 'still', view: 0 }), true);
  assert.deepEqual(states.map(({ kind }) => kind), ['connecting', 'live']);
});

test('reconnects with the newest token after the socket closed', () => {
  const { clock, transport, connection, openAndWelcome, states } = setUp();
  connection.start();
  openAndWelcome('first');
  clock.advance(10_000);
  transport.last.handlers.onClose(1006, '');
  assert.equal(states.at(-1).kind, 'waiting');
  assert.equal(transport.opened.length, 1);
  clock.advance(500);
  assert.equal(transport.opened.length, 2);
  transport.last.handlers.onOpen();
  assert.equal(transport.last.sent[0].resume, 'first');
  transport.last.handlers.onText(JSON.stringify(welcome('second')));
  transport.last.handlers.onClose(1012, '');
  clock.advance(2000);
  transport.last.handlers.onOpen();
  assert.equal(transport.last.sent[0].resume, 'second');
});

test('the wait doubles, and is reset by a healthy connection', () => {
  const { clock, transport, connection, openAndWelcome, states } = setUp();
  clock.randomValue = 0;
  connection.start();
  const waits = [];
  for (let i = 0; i < 9; i += 1) {
    transport.last.handlers.onClose(1006, '');
    waits.push(states.at(-1).retryAt - clock.now());
    clock.advance(waits.at(-1));
  }
  assert.deepEqual(waits, [500, 1000, 2000, 4000, 8000, 16_000, 30_000, 30_000, 30_000]);
  openAndWelcome();
  clock.advance(6000);
  transport.last.handlers.onClose(1006, '');
  assert.equal(states.at(-1).retryAt - clock.now(), 500);
});

test('a server that welcomes and closes at once is not retried at once', () => {
  const { clock, transport, connection, openAndWelcome, states } = setUp();
  clock.randomValue = 0;
  connection.start();
  const waits = [];
  for (let i = 0; i < 4; i += 1) {
    openAndWelcome();
    transport.last.handlers.onClose(1006, '');
    waits.push(states.at(-1).retryAt - clock.now());
    clock.advance(waits.at(-1));
  }
  assert.deepEqual(waits, [500, 1000, 2000, 4000]);
});

test('a full server is retried less often', () => {
  for (const code of [1013, 4503]) {
    const { clock, transport, connection, states } = setUp();
    connection.start();
    transport.last.handlers.onOpen();
    transport.last.handlers.onClose(code, '');
    assert.equal(states.at(-1).last.kind, 'full');
    assert.equal(states.at(-1).retryAt - clock.now(), 5000);
  }
});

test('stops after a final close code, until the user retries', () => {
  const { clock, transport, connection, openAndWelcome, states } = setUp();
  connection.start();
  openAndWelcome();
  transport.last.handlers.onClose(4409, '');
  clock.advance(600_000);
  assert.equal(transport.opened.length, 1);
  assert.deepEqual([states.at(-1).kind, states.at(-1).last.kind], ['stopped', 'superseded']);
  connection.retryNow();
  transport.last.handlers.onOpen();
  assert.equal(transport.opened.length, 2);
  assert.equal(transport.last.sent[0].resume, 'token-1');
});

test('the token of a session that is gone is dropped', () => {
  const { transport, connection, openAndWelcome } = setUp();
  connection.start();
  openAndWelcome();
  transport.last.handlers.onClose(4404, '');
  connection.retryNow();
  transport.last.handlers.onOpen();
  assert.equal('resume' in transport.last.sent[0], false);
});

test('answers pings, and closes on a silent peer', () => {
  const { clock, transport, connection, openAndWelcome, states } = setUp();
  connection.start();
  openAndWelcome();
  for (let i = 0; i < 10; i += 1) {
    clock.advance(15_000);
    transport.last.handlers.onText('{"t":"ping","ts":7}');
    assert.deepEqual(transport.last.sent.at(-1), { t: 'pong', ts: 7 });
  }
  assert.equal(states.at(-1).kind, 'live');
  clock.advance(34_999);
  assert.equal(states.at(-1).kind, 'live');
  const silent = transport.last;
  clock.advance(1);
  assert.equal(silent.closed, true);
  assert.equal(states.at(-1).kind, 'waiting');
});

test('closes on a server that opens and never welcomes', () => {
  const { clock, transport, connection, states } = setUp();
  connection.start();
  transport.last.handlers.onOpen();
  clock.advance(10_000);
  assert.equal(transport.last.closed, true);
  assert.equal(states.at(-1).kind, 'waiting');
});

test('a malformed message is reported and the connection stays open', () => {
  const { transport, connection, openAndWelcome, problems, messages } = setUp();
  connection.start();
  openAndWelcome();
  transport.last.handlers.onText('{"t":"picked","position":"here"}');
  transport.last.handlers.onText('{"t":"unheard-of"}');
  assert.deepEqual(problems, ['picked.position is not a list or null']);
  assert.equal(messages.length, 1);
  assert.ok(connection.isLive);
});

test('an idle connection keeps one timer', () => {
  const { clock, connection, openAndWelcome } = setUp();
  connection.start();
  openAndWelcome();
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
