/**
 * A clock and a socket that a test controls.
 */

import { json } from './fixtures.js';

/** Timers and animation frames that run when time is advanced. */
export class FakeClock {
  time = 0;
  randomValue = 0.5;
  #timers = new Map();
  #nextId = 1;

  now = () => this.time;
  random = () => this.randomValue;
  setTimeout = (run, ms) => this.#add(run, this.time + ms);
  clearTimeout = (id) => void this.#timers.delete(id);
  /** Display of 60 Hz. */
  requestFrame = (run) => this.#add(run, (Math.floor(this.time / 16) + 1) * 16);
  cancelFrame = (id) => void this.#timers.delete(id);

  /** Number of waiting timers and frames. */
  get waiting() {
    return this.#timers.size;
  }

  advance(ms) {
    const end = this.time + ms;
    for (;;) {
      const due = [...this.#timers].filter(([, { at }]) => at <= end).sort(([, a], [, b]) => a.at - b.at)[0];
      if (!due) break;
      this.#timers.delete(due[0]);
      this.time = Math.max(this.time, due[1].at);
      due[1].run();
    }
    this.time = end;
  }

  #add(run, at) {
    const id = this.#nextId++;
    this.#timers.set(id, { run, at });
    return id;
  }
}

/** Opens sockets whose peer is the test. */
export class FakeTransport {
  /** @type {{ url: string, subprotocol: string, handlers: any, sent: any[], closed: boolean }[]} */
  opened = [];

  open = (url, subprotocol, handlers) => {
    const socket = { url, subprotocol, handlers, sent: [], closed: false };
    this.opened.push(socket);
    return {
      send: (text) => socket.sent.push(JSON.parse(text)),
      close: () => {
        socket.closed = true;
      },
    };
  };

  get last() {
    return this.opened.at(-1);
  }
}

export const welcome = (token = 'token-1') => ({
  ...json('server_messages.json').find(({ t }) => t === 'welcome'),
  resume_token: token,
});
