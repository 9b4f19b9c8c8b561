/**
 * The link of one view to its session: settings that outlive a connection, numbered inputs, requests matched with their
 * answers, and the latency between them. Knows no element.
 */

import { Connection } from '../connection/connection.js';
import { browserClock } from '../connection/clock.js';
import { openWebSocket } from '../connection/transport.js';
import { next } from '../protocol/serial.js';
import { InputToPhoton } from './latency.js';

const CLIENT = 'surfelcast-web/0.1.0';
/** The number of the view: one view per connection, where the protocol allows more. */
const VIEW = 0;

/** @typedef {import('../protocol/types.js').ServerMessage} ServerMessage */
/** @typedef {Omit<import('../protocol/types.js').ViewSet, 'view'>} ViewSettings */
/** @typedef {import('../protocol/types.js').Welcome} Welcome */

/**
 * @typedef {object} LinkHandlers
 * @property {(state: import('../connection/connection.js').ConnectionState) => void} onState
 * @property {(welcome: Welcome, isNewScene: boolean) => void} onWelcome answered by `describeView`
 * @property {(message: ServerMessage) => void} onMessage every other message
 * @property {(frame: ArrayBuffer) => void} onFrame
 */

export class SessionLink {
  /** @type {Connection | undefined} */
  #connection;
  /** @type {Welcome | undefined} */
  #welcome;
  /** Settings to repeat on every new connection. @type {ViewSettings} */
  #settings = {};
  #inputSeq = 0;
  #requestId = 0;
  /** Id of the newest pick. */
  #pickId = 0;
  #latency = new InputToPhoton();

  /** @param {LinkHandlers} handlers */
  constructor(handlers) {
    this.handlers = handlers;
  }

  /** Whether a connection was opened and not closed here; it may be waiting for the server. */
  get isOpen() {
    return this.#connection !== undefined;
  }

  /** Whether the session receives messages now. */
  get isLive() {
    return this.#connection?.isLive ?? false;
  }

  /** @returns {import('../connection/connection.js').ConnectionState} */
  get state() {
    return this.#connection?.state ?? { kind: 'idle' };
  }

  /** The server's last welcome. */
  get welcome() {
    return this.#welcome;
  }

  /** Settings made here; what is absent is the server's default. */
  get settings() {
    return this.#settings;
  }

  /**
   * Connects to a stream and stays connected.
   * @param {string} url path or address
   * @param {import('../protocol/types.js').Caps} caps
   */
  open(url, caps) {
    this.close();
    this.#connection = new Connection({
      url,
      client: CLIENT,
      caps,
      open: openWebSocket,
      clock: browserClock,
      handlers: {
        onState: (state) => {
          if (state.kind !== 'live') this.#latency.forgetWaiting();
          this.handlers.onState(state);
        },
        onMessage: (message) => {
          if (message.t === 'welcome') this.#onWelcome(message);
          else this.handlers.onMessage(message);
        },
        onFrame: this.handlers.onFrame,
        onProblem: (error) => console.warn(`surfelcast: ${error.message}`),
      },
    });
    this.#connection.start();
  }

  close() {
    this.#connection?.stop();
    this.#connection = undefined;
    this.#latency.forgetWaiting();
  }

  /** Skips the rest of a wait for the server. */
  retry() {
    this.#connection?.retryNow();
  }

  /**
   * Describes the whole view to a new connection.
   * @param {object} view
   * @param {{ w: number, h: number } | undefined} view.size
   * @param {boolean} view.paused
   * @param {import('../protocol/types.js').Pose} view.pose
   */
  describeView({ size, paused, pose }) {
    this.update({ ...size, ...this.#settings, paused });
    this.sendCamera(pose, 'end');
  }

  /**
   * Changes settings; they are repeated on every new connection.
   * @param {ViewSettings} settings
   */
  set(settings) {
    this.#settings = { ...this.#settings, ...settings };
    this.update(settings);
  }

  /**
   * Changes settings for this connection only.
   * @param {ViewSettings} settings
   */
  update(settings) {
    this.#connection?.send({ t: 'view.set', view: VIEW, ...settings });
  }

  /**
   * @param {import('../protocol/types.js').Pose} pose
   * @param {import('../protocol/types.js').Phase} phase
   */
  sendCamera(pose, phase) {
    return this.#sendInput({ t: 'camera', view: VIEW, pose, phase });
  }

  /**
   * @param {import('../protocol/types.js').LightPatch} patch
   * @param {import('../protocol/types.js').Phase} phase
   * @returns {number} the input's number, which the frame that contains it repeats as `inputSeq`
   */
  editLights(patch, phase) {
    return this.#sendInput({ t: 'light', patch, phase });
  }

  /**
   * Requests the surface point at a place in the image.
   * @param {number} x 0 (left) to 1
   * @param {number} y 0 (top) to 1
   */
  pick(x, y) {
    this.#pickId = this.#request('pick', x, y) ?? 0;
  }

  /**
   * Whether this is the answer to the newest pick.
   * @param {Extract<import('../protocol/types.js').ServerMessage, { t: 'picked' }>} picked
   */
  isNewestPick(picked) {
    return picked.re === this.#pickId;
  }

  /**
   * Requests an inspection of a place in the image.
   * @param {number} x 0 (left) to 1
   * @param {number} y 0 (top) to 1
   * @returns {number | undefined} id of the request; nothing if it could not be sent
   */
  inspect(x, y) {
    return this.#request('inspect', x, y);
  }

  requestStill() {
    this.#connection?.send({ t: 'still', view: VIEW });
  }

  /** @param {import('./frame-queue.js').Acknowledgement} ack */
  acknowledge({ seq, decodeUs, dropped, queue }) {
    this.#connection?.send({ t: 'ack', view: VIEW, seq, decode_us: decodeUs, present_ms: performance.now(), dropped, queue });
  }

  /**
   * A frame that contains all inputs up to `inputSeq` is on the screen.
   * @param {number} inputSeq
   * @param {number} at milliseconds
   */
  presented(inputSeq, at) {
    this.#latency.presented(inputSeq, at);
  }

  /** Percentiles of the time from an input to the first frame that contains it. */
  latency() {
    return this.#latency.percentiles();
  }

  /** @param {Welcome} welcome */
  #onWelcome(welcome) {
    const isNewScene = welcome.session.scene !== this.#welcome?.session.scene;
    this.#welcome = welcome;
    if (isNewScene) {
      this.#settings.exposure = welcome.cameras[0]?.exposure ?? 1;
      // Another server may not offer what the last one did.
      if (!welcome.techniques.some(({ id }) => id === this.#settings.technique)) delete this.#settings.technique;
      if (!welcome.outputs.some(({ id }) => id === this.#settings.aov)) delete this.#settings.aov;
    }
    this.handlers.onWelcome(welcome, isNewScene);
  }

  /**
   * Numbers and sends an input.
   * @param {Omit<Extract<import('../protocol/types.js').ClientMessage, { t: 'camera' }>, 'seq' | 'ts'> |
   *   Omit<Extract<import('../protocol/types.js').ClientMessage, { t: 'light' }>, 'seq' | 'ts'>} input
   */
  #sendInput(input) {
    if (this.isLive) {
      this.#inputSeq = next(this.#inputSeq);
      const ts = performance.now();
      this.#connection?.send({ ...input, seq: this.#inputSeq, ts });
      this.#latency.sent(this.#inputSeq, ts);
    }
    return this.#inputSeq;
  }

  /**
   * @param {'pick' | 'inspect'} t
   * @param {number} x
   * @param {number} y
   * @returns {number | undefined}
   */
  #request(t, x, y) {
    this.#requestId += 1;
    return this.#connection?.send({ t, id: this.#requestId, view: VIEW, x, y }) ? this.#requestId : undefined;
  }
}
