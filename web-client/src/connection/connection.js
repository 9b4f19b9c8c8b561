/**
 * A lasting connection to a session's stream: hello and welcome, liveness, reconnection with the resume token.
 * Knows no canvas and no element.
 */

import { parseServerMessage, SUBPROTOCOL, VERSION } from '../protocol/messages.js';
import { verdictOf } from '../protocol/close.js';
import { delayMs } from './backoff.js';

/** The server must welcome us within this time of the socket opening. */
const WELCOME_TIMEOUT_MS = 10_000;
/** The server pings every 15 s; two missed pings mean that the peer is gone even if the socket stays open. */
const SILENCE_MS = 35_000;
/** A connection that stayed open this long resets the back-off. */
const HEALTHY_MS = 5_000;

/**
 * @typedef {(
 *   | { kind: 'idle' }
 *   | { kind: 'connecting', attempt: number, last?: import('../protocol/close.js').Verdict }
 *   | { kind: 'live' }
 *   | { kind: 'waiting', attempt: number, retryAt: number, last: import('../protocol/close.js').Verdict }
 *   | { kind: 'stopped', last: import('../protocol/close.js').Verdict }
 * )} ConnectionState `retryAt` is in the clock's milliseconds
 */

/**
 * @typedef {object} ConnectionHandlers
 * @property {(state: ConnectionState) => void} onState
 * @property {(message: import('../protocol/types.js').ServerMessage) => void} onMessage
 * @property {(frame: ArrayBuffer) => void} onFrame
 * @property {(error: Error) => void} onProblem a message that could not be parsed; the connection stays open
 */

export class Connection {
  /** @type {import('./transport.js').Transport | undefined} */
  #transport;
  /** @type {ConnectionState} */
  #state = { kind: 'idle' };
  /** @type {string | undefined} */
  #resumeToken;
  /** Failed attempts since the last healthy connection. */
  #attempt = 0;
  #liveSince = 0;
  /** @type {number | undefined} */
  #timer;
  #receivedAt = 0;

  /**
   * @param {object} options
   * @param {string} options.url path or address of the stream
   * @param {import('../protocol/types.js').Caps} options.caps
   * @param {string} options.client program and version, for the server's log
   * @param {import('./transport.js').TransportFactory} options.open
   * @param {import('./clock.js').Clock} options.clock
   * @param {ConnectionHandlers} options.handlers
   */
  constructor(options) {
    this.options = options;
  }

  get state() {
    return this.#state;
  }

  get isLive() {
    return this.#state.kind === 'live';
  }

  /** Connects, unless already connected or connecting. */
  start() {
    if (this.#state.kind === 'idle' || this.#state.kind === 'stopped') this.#connect();
  }

  /** Skips the rest of a wait, or reconnects after the connection had stopped. */
  retryNow() {
    if (this.#state.kind === 'waiting' || this.#state.kind === 'stopped') this.#connect();
  }

  /** Closes the connection; no handler is called afterwards. */
  stop() {
    this.#clearTimer();
    this.#transport?.close();
    this.#transport = undefined;
    this.#state = { kind: 'idle' };
  }

  /**
   * Sends a message if the connection is live.
   * @param {import('../protocol/types.js').ClientMessage} message
   * @returns {boolean} whether it was sent
   */
  send(message) {
    if (!this.isLive) return false;
    this.#transport?.send(JSON.stringify(message));
    return true;
  }

  #connect() {
    const { clock, open, url } = this.options;
    this.#clearTimer();
    const last = 'last' in this.#state ? this.#state.last : undefined;
    this.#setState({ kind: 'connecting', attempt: this.#attempt, ...(last && { last }) });
    try {
      this.#transport = open(url, SUBPROTOCOL, {
        onOpen: () => this.#hello(),
        onText: (text) => this.#onText(text),
        onBinary: (frame) => this.#onBinary(frame),
        onClose: (code) => this.#onClose(code),
      });
    } catch {
      // The address itself is invalid. Waiting does not help, but the same path informs the user.
      this.#onClose(0);
      return;
    }
    this.#receivedAt = clock.now();
  }

  #hello() {
    const { caps, client, clock } = this.options;
    /** @type {import('../protocol/types.js').ClientMessage} */
    const hello = { t: 'hello', v: [VERSION], client, caps, ...(this.#resumeToken && { resume: this.#resumeToken }) };
    this.#transport?.send(JSON.stringify(hello));
    this.#timer = clock.setTimeout(() => this.#giveUp(), WELCOME_TIMEOUT_MS);
  }

  /** @param {string} text */
  #onText(text) {
    const { clock, handlers } = this.options;
    this.#receivedAt = clock.now();
    let message;
    try {
      message = parseServerMessage(text);
    } catch (error) {
      handlers.onProblem(/** @type {Error} */ (error));
      return;
    }
    if (!message) return;
    if (message.t === 'ping') {
      this.#transport?.send(JSON.stringify({ t: 'pong', ts: message.ts }));
      return;
    }
    if (message.t === 'welcome') {
      this.#resumeToken = message.resume_token;
      this.#liveSince = clock.now();
      this.#clearTimer();
      this.#watchSilence();
      // The state first, so that a handler of the welcome can send.
      this.#setState({ kind: 'live' });
    }
    handlers.onMessage(message);
  }

  /** @param {ArrayBuffer} frame */
  #onBinary(frame) {
    this.#receivedAt = this.options.clock.now();
    if (this.isLive) this.options.handlers.onFrame(frame);
  }

  /** @param {number} code */
  #onClose(code) {
    const { clock } = this.options;
    this.#clearTimer();
    this.#transport = undefined;
    if (this.isLive && clock.now() - this.#liveSince >= HEALTHY_MS) this.#attempt = 0;
    const last = verdictOf(code);
    if (last.kind === 'gone') this.#resumeToken = undefined;
    if (!last.retry) {
      this.#attempt = 0;
      this.#setState({ kind: 'stopped', last });
      return;
    }
    const wait = delayMs(this.#attempt, clock.random(), last.minDelayMs);
    this.#attempt += 1;
    this.#timer = clock.setTimeout(() => this.#connect(), wait);
    this.#setState({ kind: 'waiting', attempt: this.#attempt, retryAt: clock.now() + wait, last });
  }

  /** Treats a silent peer as disconnected. */
  #giveUp() {
    this.#transport?.close();
    this.#onClose(0);
  }

  #watchSilence() {
    const { clock } = this.options;
    const left = this.#receivedAt + SILENCE_MS - clock.now();
    if (left <= 0) this.#giveUp();
    else this.#timer = clock.setTimeout(() => this.#watchSilence(), left);
  }

  #clearTimer() {
    if (this.#timer !== undefined) this.options.clock.clearTimeout(this.#timer);
    this.#timer = undefined;
  }

  /** @param {ConnectionState} state */
  #setState(state) {
    this.#state = state;
    this.options.handlers.onState(state);
  }
}
