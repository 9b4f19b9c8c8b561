/**
 * `<surfelcast-view src="/v1/sessions/ID/stream">`: one view of a session. Works alone on any page.
 *
 * Attributes: `src` (stream path or address), `max-spp` (stop refining at this many samples a pixel),
 * `resolution` (factor on the picture's size, 0.1 to 1), `inspecting` (a click asks which surfels light a point).
 * Events, all with `detail`: `welcome`, `lights`, `stats`, `notice`, `refused` (messages of the server as they came),
 * `state` (connection), `frame` (header of the picture just shown), `pose` ({ pose, resting }), `inspecting` ({ on,
 * waiting }), `inspected` (an `Answer`).
 */

import { Connection } from '../connection/connection.js';
import { browserClock } from '../connection/clock.js';
import { openWebSocket } from '../connection/transport.js';
import { next } from '../protocol/serial.js';
import { focus, spokenDirection } from './camera.js';
import { decodableCodecs, missingFeatures, prefersReducedMotion } from './capabilities.js';
import { CanvasPresenter } from './canvas-presenter.js';
import { Flight } from './flight.js';
import { FrameQueue } from './frame-queue.js';
import { InspectMode, marking } from './inspect-mode.js';
import { listenToKeyboard } from './keyboard-controls.js';
import { InputToPhoton } from './latency.js';
import { PointerControls } from './pointer-controls.js';
import { Rate } from './rate.js';
import { Rig } from './rig.js';
import { pictureSize } from './size.js';
import { watchSize } from './size-watch.js';
import { StatusCard } from './status-card.js';
import { sheet, template } from './view-template.js';

const CLIENT = 'surfelcast-web/0.1.0';
/** One view a connection; the protocol could carry more. */
const VIEW = 0;

/** @typedef {import('../protocol/messages.js').ServerMessage} ServerMessage */
/** @typedef {import('../protocol/messages.js').ViewSettings} ViewSettings */
/** @typedef {{ inspection?: import('../protocol/messages.js').Inspection | null, refusal?: string }} Answer to an inspected point */

export class SurfelcastView extends HTMLElement {
  static observedAttributes = ['src', 'max-spp', 'resolution', 'inspecting'];

  /** @type {Connection | undefined} */
  #connection;
  /** @type {AbortController | undefined} */
  #listening;
  /** @type {(() => void) | undefined} */
  #unwatchSize;
  /** @type {import('../protocol/messages.js').Welcome | undefined} */
  #welcome;
  /** Scene that the rig stands in. */
  #scene = '';
  #inputSeq = 0;
  #requestId = 0;
  /** Request whose answer the camera will go to. */
  #pickId = 0;
  /** Whether the note on the card is about a picture that could not be read. */
  #unreadable = false;
  #area = { width: 0, height: 0 };
  /** Wishes to repeat on every new connection. @type {ViewSettings} */
  #wishes = {};
  #fps = new Rate();
  #bytes = new Rate();
  #latency = new InputToPhoton();

  constructor() {
    super();
    const root = this.attachShadow({ mode: 'open', delegatesFocus: true });
    root.adoptedStyleSheets = [sheet];
    root.append(template.content.cloneNode(true));
    /** @param {string} selector */
    const part = (selector) => /** @type {HTMLElement} */ (root.querySelector(selector));
    /** The canvas on which the picture is drawn. */
    this.canvas = /** @type {HTMLCanvasElement} */ (part('canvas'));
    this.direction = part('.direction');
    this.modeHint = part('.flying');
    this.action = /** @type {HTMLButtonElement} */ (part('button'));
    this.card = new StatusCard({
      card: part('.card'),
      title: part('.card strong'),
      detail: part('.card span'),
      action: this.action,
      live: part('.live'),
    });
    this.presenter = new CanvasPresenter(this.canvas, {
      shown: (picture) => this.#shown(picture),
      dropped: () => this.frames.countDropped(),
    });
    this.frames = new FrameQueue({
      decode: (payload, type) => createImageBitmap(new Blob([payload], { type })),
      acknowledge: (ack) => this.#acknowledge(ack),
      present: (picture) => this.presenter.present(picture),
      fail: (error) => this.#frameFailed(error),
      now: () => performance.now(),
    });
    /** Camera of the view. */
    this.rig = new Rig({
      send: (pose, phase) => this.#sendInput({ t: 'camera', view: VIEW, pose, phase }),
      changed: (pose, resting) => this.#poseChanged(pose, resting),
      reducedMotion: prefersReducedMotion,
    });
    this.flight = new Flight(this.rig, (on) => this.#flyModeChanged(on));
    /** What a click means while `inspecting`. */
    this.inspectMode = new InspectMode({
      send: ({ x, y }) => this.#ask('inspect', x, y),
      changed: (mode) => this.#tell('inspecting', mode),
      mark: marking(part('.marker')),
    });
  }

  /** Stream path or address. */
  get src() {
    return this.getAttribute('src') ?? '';
  }

  set src(value) {
    if (value !== this.src) this.setAttribute('src', value);
  }

  /** The server's last welcome. */
  get welcome() {
    return this.#welcome;
  }

  /** Whether the server listens at present. */
  get isLive() {
    return this.#connection?.isLive ?? false;
  }

  /** Exposure wished for, linear factor. */
  get exposure() {
    return this.#wishes.exposure ?? 1;
  }

  /** Technique wished for; nothing means the server's default. */
  get technique() {
    return this.#wishes.technique;
  }

  /** Output wished for instead of radiance. */
  get output() {
    return this.#wishes.aov ?? undefined;
  }

  /** Whether a click asks what lights the point under it. */
  get inspecting() {
    return this.hasAttribute('inspecting');
  }

  set inspecting(on) {
    this.toggleAttribute('inspecting', on);
  }

  connectedCallback() {
    this.#listening = new AbortController();
    const { signal } = this.#listening;
    const { rig, flight, inspectMode: inspect } = this;
    new PointerControls(this.canvas, { rig, flight, tap: (x, y) => this.#tap(x, y), pick: (x, y) => this.#pick(x, y), signal });
    listenToKeyboard(this.canvas, { rig, flight, inspect, leaveInspect: () => this.removeAttribute('inspecting'), signal });
    this.#unwatchSize = watchSize(this, (area) => {
      this.#area = area;
      this.#sendSize();
    });
    this.action.addEventListener('click', () => this.#act(), { signal });
    document.addEventListener('visibilitychange', () => this.#visibilityChanged(), { signal });
    document.addEventListener('pointerlockchange', () => this.#pointerLockChanged(), { signal });
    window.addEventListener('online', () => this.retry(), { signal });
    void this.#open();
  }

  disconnectedCallback() {
    this.#listening?.abort();
    this.#unwatchSize?.();
    this.flight.setMode(false);
    this.flight.releaseAll();
    this.#close();
    this.card.dispose();
  }

  /**
   * @param {string} name
   * @param {string | null} before
   * @param {string | null} after
   */
  attributeChangedCallback(name, before, after) {
    if (before === after) return;
    if (name === 'max-spp') {
      const limit = Number(after);
      if (Number.isInteger(limit) && limit > 0) this.setView({ max_spp: limit });
    } else if (name === 'resolution') {
      this.#sendSize();
    } else if (name === 'inspecting') {
      this.inspectMode.set(after !== null);
    } else if (this.isConnected) {
      void this.#open();
    }
  }

  /**
   * Changes wishes for the view; they are repeated on every reconnect.
   * @param {ViewSettings} settings
   */
  setView(settings) {
    this.#wishes = { ...this.#wishes, ...settings };
    this.#connection?.send({ t: 'view.set', view: VIEW, ...settings });
  }

  /**
   * Edits the session's lights.
   * @param {import('../protocol/messages.js').LightPatch} patch
   * @param {import('../protocol/messages.js').Phase} phase
   * @returns {number} the input's number, which the `frame` that contains it repeats as `inputSeq`
   */
  editLights(patch, phase) {
    return this.#sendInput({ t: 'light', patch, phase });
  }

  /**
   * Asks which surfels light a point, while `inspecting`; `inspected` follows.
   * @param {number} x 0 (left) to 1
   * @param {number} y 0 (top) to 1
   */
  inspect(x, y) {
    this.inspectMode.ask({ x, y });
  }

  /** Asks for a finished picture of the present state now. */
  requestStill() {
    this.#connection?.send({ t: 'still', view: VIEW });
  }

  /** Skips the rest of a wait for the server. */
  retry() {
    this.#connection?.retryNow();
  }

  /** Present rates and latencies, as measured here. */
  measure() {
    const now = performance.now();
    return {
      framesPerSecond: this.#fps.perSecond(now),
      bytesPerSecond: this.#bytes.perSecond(now),
      latency: this.#latency.percentiles(),
    };
  }

  /**
   * The picture on the canvas as PNG.
   * @returns {Promise<Blob>}
   */
  capture() {
    return new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('the browser could not encode the picture'))), 'image/png');
    });
  }

  async #open() {
    this.#close();
    const { src } = this;
    if (!src) return;
    const missing = missingFeatures();
    if (missing.length > 0) {
      this.card.setNote({ title: 'This browser cannot show the view', detail: `It lacks ${missing.join(', ')}. A current Firefox, Chrome, Edge or Safari can.` });
      this.card.setState({ kind: 'live' });
      return;
    }
    const codecs = await decodableCodecs();
    // Another `src` may have come, or the element may have gone, while the codecs were tried.
    if (src !== this.src || !this.isConnected || this.#connection) return;
    this.#connection = new Connection({
      url: src,
      client: CLIENT,
      caps: { codecs, dpr: Math.max(1, devicePixelRatio), reduced_motion: prefersReducedMotion() },
      open: openWebSocket,
      clock: browserClock,
      handlers: {
        onState: (state) => this.#stateChanged(state),
        onMessage: (message) => this.#hear(message),
        onFrame: (frame) => this.frames.push(frame),
        onProblem: (error) => console.warn(`surfelcast: ${error.message}`),
      },
    });
    this.#connection.start();
  }

  #close() {
    this.#connection?.stop();
    this.#connection = undefined;
    this.frames.reset();
    this.#latency.forgetWaiting();
    this.rig.abandon();
    this.inspectMode.lost();
  }

  #act() {
    const state = this.#connection?.state;
    if (state?.kind === 'stopped' && state.last.kind === 'outdated') location.reload();
    else this.retry();
  }

  /** @param {import('../connection/connection.js').ConnectionState} state */
  #stateChanged(state) {
    if (state.kind !== 'live') {
      this.frames.reset();
      this.#latency.forgetWaiting();
      this.inspectMode.lost();
    }
    this.card.setState(state);
    this.#tell('state', state);
  }

  /** @param {ServerMessage} message */
  #hear(message) {
    switch (message.t) {
      case 'welcome':
        this.#greet(message);
        break;
      case 'picked':
        if (message.position && message.re === this.#pickId) this.rig.goTo(focus(this.rig.pose, message.position));
        break;
      case 'inspected':
        if (this.inspectMode.answered(message.re) === 'newest') this.#tell('inspected', { inspection: message.inspection ?? null });
        break;
      case 'notice':
        this.#notice(message);
        break;
      case 'error': {
        const question = this.inspectMode.answered(message.re);
        if (question === 'newest') this.#tell('inspected', { refusal: message.detail });
        else if (question === 'other') this.#tell('refused', message);
        break;
      }
      case 'lights':
      case 'stats':
        this.#tell(message.t, message);
        break;
    }
  }

  /** @param {import('../protocol/messages.js').Welcome} welcome */
  #greet(welcome) {
    this.#welcome = welcome;
    this.card.setNote(undefined);
    if (welcome.session.scene !== this.#scene) {
      this.#scene = welcome.session.scene;
      this.presenter.clear();
      this.card.setHasPicture(false);
      this.rig.enterScene(welcome);
      this.#wishes.exposure = welcome.cameras[0]?.exposure ?? 1;
      // What one server offers another may not.
      if (!welcome.techniques.some(({ id }) => id === this.#wishes.technique)) delete this.#wishes.technique;
      if (!welcome.outputs.some(({ id }) => id === this.#wishes.aov)) delete this.#wishes.aov;
    }
    this.#connection?.send({ t: 'view.set', view: VIEW, ...this.#size(), ...this.#wishes, paused: document.hidden });
    this.#sendInput({ t: 'camera', view: VIEW, pose: this.rig.pose, phase: 'end' });
    this.#tell('welcome', welcome);
  }

  /** @param {import('../protocol/messages.js').Notice} notice */
  #notice(notice) {
    const titles = {
      draining: 'The render server is about to restart',
      device_lost: 'The graphics device failed; restoring it',
      quota: 'A limit was reached',
      restored: '',
    };
    const title = titles[notice.kind];
    if (title !== undefined) this.card.setNote(title ? { title, detail: notice.detail } : undefined);
    this.#tell('notice', notice);
  }

  /** @param {import('./frame-queue.js').Picture} picture */
  #shown({ header, bytes }) {
    const now = performance.now();
    this.#fps.add(now, 1);
    this.#bytes.add(now, bytes);
    this.#latency.presented(header.inputSeq, now);
    this.card.setHasPicture(true);
    if (this.#unreadable) {
      this.#unreadable = false;
      this.card.setNote(undefined);
    }
    this.#tell('frame', header);
  }

  /** @param {Error} error */
  #frameFailed(error) {
    this.#unreadable = true;
    this.card.setNote({ title: 'A picture could not be read', detail: error.message });
  }

  /** @param {import('./frame-queue.js').Acknowledgement} ack */
  #acknowledge({ seq, decodeUs, dropped, queue }) {
    this.#connection?.send({ t: 'ack', view: VIEW, seq, decode_us: decodeUs, present_ms: performance.now(), dropped, queue });
  }

  /**
   * Numbers and sends an input.
   * @param {Omit<Extract<import('../protocol/messages.js').ClientMessage, { t: 'camera' }>, 'seq' | 'ts'> |
   *   Omit<Extract<import('../protocol/messages.js').ClientMessage, { t: 'light' }>, 'seq' | 'ts'>} input
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
   * @param {number} x CSS pixels in the canvas
   * @param {number} y CSS pixels in the canvas
   */
  #pick(x, y) {
    const { clientWidth, clientHeight } = this.canvas;
    this.#pickId = this.#ask('pick', x / clientWidth, y / clientHeight) ?? 0;
  }

  /**
   * @param {number} x CSS pixels in the canvas
   * @param {number} y CSS pixels in the canvas
   * @returns {boolean} whether the tap was for the inspector
   */
  #tap(x, y) {
    if (this.inspecting) this.inspect(x / this.canvas.clientWidth, y / this.canvas.clientHeight);
    return this.inspecting;
  }

  /**
   * Asks about a point of the picture.
   * @param {'pick' | 'inspect'} t
   * @param {number} x
   * @param {number} y
   * @returns {number | undefined} id of the request; nothing when nobody hears it
   */
  #ask(t, x, y) {
    this.#requestId += 1;
    return this.#connection?.send({ t, id: this.#requestId, view: VIEW, x, y }) ? this.#requestId : undefined;
  }

  #size() {
    if (!this.#welcome || this.#area.width === 0) return undefined;
    const factor = Math.min(1, Math.max(0.1, Number(this.getAttribute('resolution') ?? 1) || 1));
    return pictureSize(this.#area, devicePixelRatio, factor, this.#welcome.limits);
  }

  #sendSize() {
    const size = this.#size();
    if (size) this.#connection?.send({ t: 'view.set', view: VIEW, ...size });
  }

  #visibilityChanged() {
    this.#connection?.send({ t: 'view.set', view: VIEW, paused: document.hidden });
    if (!document.hidden) this.retry();
  }

  /**
   * @param {import('../protocol/messages.js').Pose} pose
   * @param {boolean} resting
   */
  #poseChanged(pose, resting) {
    this.inspectMode.moved();
    if (resting) {
      const text = `Rendered view of ${this.#welcome?.session.scene_name ?? 'the scene'}, seen from ${spokenDirection(pose)}`;
      this.canvas.setAttribute('aria-label', text);
      this.direction.textContent = text;
    }
    this.#tell('pose', { pose, resting });
  }

  /** @param {boolean} on */
  #flyModeChanged(on) {
    this.modeHint.hidden = !on;
    if (!on) {
      if (document.pointerLockElement === this || this.shadowRoot?.pointerLockElement) document.exitPointerLock();
      return;
    }
    // Where the browser refuses, dragging looks around instead.
    Promise.resolve(this.canvas.requestPointerLock?.()).catch(() => undefined);
  }

  #pointerLockChanged() {
    if (!document.pointerLockElement && this.flight.mode) this.flight.setMode(false);
  }

  /**
   * @param {string} type
   * @param {unknown} detail
   */
  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}

if (!customElements.get('surfelcast-view')) customElements.define('surfelcast-view', SurfelcastView);
