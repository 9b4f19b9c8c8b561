/**
 * `<surfelcast-view src="/v1/sessions/ID/stream">`: one view of a session. Works alone on any page.
 *
 * Attributes: `src` (stream path or address), `max-spp` (stop refining at this many samples per pixel),
 * `resolution` (factor on the image size, 0.1 to 1), `inspecting` (a click requests what lights a point).
 * Events, all with `detail`: `welcome`, `lights`, `stats`, `notice`, `refused` (messages of the server, unchanged),
 * `state` (connection), `frame` (header of the frame just shown), `pose` ({ pose, resting }), `inspecting` ({ on,
 * waiting }), `inspected` (an `Answer`).
 */

import { focus, spokenDirection } from './camera.js';
import { decodableCodecs, missingFeatures, prefersReducedMotion } from './capabilities.js';
import { CanvasPresenter } from './canvas-presenter.js';
import { Flight } from './flight.js';
import { FrameQueue } from './frame-queue.js';
import { InspectMode, marking } from './inspect-mode.js';
import { listenToKeyboard } from './keyboard-controls.js';
import { PointerControls } from './pointer-controls.js';
import { Rate } from './rate.js';
import { Rig } from './rig.js';
import { SessionLink } from './session-link.js';
import { imageSize } from './size.js';
import { watchSize } from './size-watch.js';
import { StatusCard } from './status-card.js';
import { sheet, template } from './view-template.js';

/** @typedef {import('../protocol/types.js').ServerMessage} ServerMessage */
/** @typedef {Omit<import('../protocol/types.js').ViewSet, 'view'>} ViewSettings */
/** @typedef {import('../protocol/types.js').Inspection} Inspection */
/** @typedef {{ inspection?: Inspection | null, refusal?: string }} Answer to an inspected point */

export class SurfelcastView extends HTMLElement {
  static observedAttributes = ['src', 'max-spp', 'resolution', 'inspecting'];

  /** @type {AbortController | undefined} */
  #listening;
  /** @type {(() => void) | undefined} */
  #unwatchSize;
  /** Whether the note on the card is about a frame that could not be decoded. */
  #undecodable = false;
  #area = { width: 0, height: 0 };
  #fps = new Rate();
  #bytes = new Rate();
  #link = new SessionLink({
    onState: (state) => this.#onState(state),
    onWelcome: (welcome, isNewScene) => this.#onWelcome(welcome, isNewScene),
    onMessage: (message) => this.#onMessage(message),
    onFrame: (frame) => this.frames.push(frame),
  });

  constructor() {
    super();
    const root = this.attachShadow({ mode: 'open', delegatesFocus: true });
    root.adoptedStyleSheets = [sheet];
    root.append(template.content.cloneNode(true));
    /** @param {string} selector */
    const part = (selector) => /** @type {HTMLElement} */ (root.querySelector(selector));
    /** The canvas on which frames are drawn. */
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
      shown: (frame) => this.#onShown(frame),
      dropped: () => this.frames.countDropped(),
    });
    this.frames = new FrameQueue({
      decode: (payload, type) => createImageBitmap(new Blob([payload], { type })),
      acknowledge: (ack) => this.#link.acknowledge(ack),
      present: (frame) => this.presenter.present(frame),
      fail: (error) => this.#onUndecodable(error),
      now: () => performance.now(),
    });
    /** Camera of the view. */
    this.rig = new Rig({
      send: (pose, phase) => this.#link.sendCamera(pose, phase),
      changed: (pose, resting) => this.#onPose(pose, resting),
      reducedMotion: prefersReducedMotion,
    });
    this.flight = new Flight(this.rig, (on) => this.#onFlyMode(on));
    /** What a click means while `inspecting`. */
    this.inspectMode = new InspectMode({
      send: ({ x, y }) => this.#link.inspect(x, y),
      changed: (mode) => this.#emit('inspecting', mode),
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
    return this.#link.welcome;
  }

  /** Whether the session receives messages now. */
  get isLive() {
    return this.#link.isLive;
  }

  /** Exposure, linear factor. */
  get exposure() {
    return this.#link.settings.exposure ?? 1;
  }

  /** Chosen technique; nothing means the server's default. */
  get technique() {
    return this.#link.settings.technique;
  }

  /** Chosen output; nothing means radiance. */
  get output() {
    return this.#link.settings.aov ?? undefined;
  }

  /** Whether a click requests what lights the point under it. */
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
    new PointerControls(this.canvas, { rig, flight, tap: (x, y) => this.#onTap(x, y), pick: (x, y) => this.#onPick(x, y), signal });
    listenToKeyboard(this.canvas, { rig, flight, inspect, leaveInspect: () => this.removeAttribute('inspecting'), signal });
    this.#unwatchSize = watchSize(this, (area) => {
      this.#area = area;
      this.#sendSize();
    });
    this.action.addEventListener('click', () => this.#onAction(), { signal });
    document.addEventListener('visibilitychange', () => this.#onVisibility(), { signal });
    document.addEventListener('pointerlockchange', () => this.#onPointerLock(), { signal });
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
   * Changes settings of the view; they are repeated on every new connection.
   * @param {ViewSettings} settings
   */
  setView(settings) {
    this.#link.set(settings);
  }

  /**
   * Edits the session's lights.
   * @param {import('../protocol/types.js').LightPatch} patch
   * @param {import('../protocol/types.js').Phase} phase
   * @returns {number} the input's number, which the `frame` that contains it repeats as `inputSeq`
   */
  editLights(patch, phase) {
    return this.#link.editLights(patch, phase);
  }

  /**
   * Requests what lights a point, while `inspecting`; `inspected` follows.
   * @param {number} x 0 (left) to 1
   * @param {number} y 0 (top) to 1
   */
  inspect(x, y) {
    this.inspectMode.request({ x, y });
  }

  /** Requests a finished frame of the present state now. */
  requestStill() {
    this.#link.requestStill();
  }

  /** Skips the rest of a wait for the server. */
  retry() {
    this.#link.retry();
  }

  /** Present rates and latencies, as measured here. */
  measure() {
    const now = performance.now();
    return {
      framesPerSecond: this.#fps.perSecond(now),
      bytesPerSecond: this.#bytes.perSecond(now),
      latency: this.#link.latency(),
    };
  }

  /**
   * The image on the canvas as PNG.
   * @returns {Promise<Blob>}
   */
  capture() {
    return new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('the browser could not encode the image'))), 'image/png');
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
    // `src` may have changed, or the element may have been removed, while the codecs were probed.
    if (src !== this.src || !this.isConnected || this.#link.isOpen) return;
    this.#link.open(src, { codecs, dpr: Math.max(1, devicePixelRatio), reduced_motion: prefersReducedMotion() });
  }

  #close() {
    this.#link.close();
    this.frames.reset();
    this.rig.abandon();
    this.inspectMode.onDisconnect();
  }

  /** @param {import('../connection/connection.js').ConnectionState} state */
  #onState(state) {
    if (state.kind !== 'live') {
      this.frames.reset();
      this.inspectMode.onDisconnect();
    }
    this.card.setState(state);
    this.#emit('state', state);
  }

  /**
   * @param {import('../protocol/types.js').Welcome} welcome
   * @param {boolean} isNewScene
   */
  #onWelcome(welcome, isNewScene) {
    this.card.setNote(undefined);
    if (isNewScene) {
      this.presenter.clear();
      this.card.setHasImage(false);
      this.rig.enterScene(welcome);
    }
    this.#link.describeView({ size: this.#imageSize(), paused: document.hidden, pose: this.rig.pose });
    this.#emit('welcome', welcome);
  }

  /** @param {ServerMessage} message */
  #onMessage(message) {
    switch (message.t) {
      case 'picked':
        if (message.position && this.#link.isNewestPick(message)) this.rig.goTo(focus(this.rig.pose, message.position));
        break;
      case 'inspected':
        if (this.inspectMode.onAnswer(message.re) === 'newest') this.#emit('inspected', { inspection: message.inspection ?? null });
        break;
      case 'notice':
        this.#onNotice(message);
        break;
      case 'error': {
        const request = this.inspectMode.onAnswer(message.re);
        if (request === 'newest') this.#emit('inspected', { refusal: message.detail });
        else if (request === 'other') this.#emit('refused', message);
        break;
      }
      case 'lights':
      case 'stats':
        this.#emit(message.t, message);
        break;
    }
  }

  /** @param {Extract<import('../protocol/types.js').ServerMessage, { t: 'notice' }>} notice */
  #onNotice(notice) {
    const titles = {
      draining: 'The render server is about to restart',
      device_lost: 'The graphics device failed; restoring it',
      quota: 'A limit was reached',
      restored: '',
    };
    const title = titles[notice.kind];
    if (title !== undefined) this.card.setNote(title ? { title, detail: notice.detail } : undefined);
    this.#emit('notice', notice);
  }

  /** @param {import('./frame-queue.js').DecodedFrame} frame */
  #onShown({ header, bytes }) {
    const now = performance.now();
    this.#fps.add(now, 1);
    this.#bytes.add(now, bytes);
    this.#link.presented(header.inputSeq, now);
    this.card.setHasImage(true);
    if (this.#undecodable) {
      this.#undecodable = false;
      this.card.setNote(undefined);
    }
    this.#emit('frame', header);
  }

  /** @param {Error} error */
  #onUndecodable(error) {
    this.#undecodable = true;
    this.card.setNote({ title: 'A frame could not be decoded', detail: error.message });
  }

  #onAction() {
    const { state } = this.#link;
    if (state.kind === 'stopped' && state.last.kind === 'outdated') location.reload();
    else this.retry();
  }

  /**
   * @param {number} x CSS pixels in the canvas
   * @param {number} y CSS pixels in the canvas
   */
  #onPick(x, y) {
    this.#link.pick(x / this.canvas.clientWidth, y / this.canvas.clientHeight);
  }

  /**
   * @param {number} x CSS pixels in the canvas
   * @param {number} y CSS pixels in the canvas
   * @returns {boolean} whether the inspector took the tap
   */
  #onTap(x, y) {
    if (this.inspecting) this.inspect(x / this.canvas.clientWidth, y / this.canvas.clientHeight);
    return this.inspecting;
  }

  #imageSize() {
    if (!this.welcome || this.#area.width === 0) return undefined;
    const factor = Math.min(1, Math.max(0.1, Number(this.getAttribute('resolution') ?? 1) || 1));
    return imageSize(this.#area, devicePixelRatio, factor, this.welcome.limits);
  }

  #sendSize() {
    const size = this.#imageSize();
    if (size) this.#link.update(size);
  }

  #onVisibility() {
    this.#link.update({ paused: document.hidden });
    if (!document.hidden) this.retry();
  }

  /**
   * @param {import('../protocol/types.js').Pose} pose
   * @param {boolean} resting
   */
  #onPose(pose, resting) {
    this.inspectMode.onCameraMove();
    if (resting) {
      const text = `Rendered view of ${this.welcome?.session.scene_name ?? 'the scene'}, seen from ${spokenDirection(pose)}`;
      this.canvas.setAttribute('aria-label', text);
      this.direction.textContent = text;
    }
    this.#emit('pose', { pose, resting });
  }

  /** @param {boolean} on */
  #onFlyMode(on) {
    this.modeHint.hidden = !on;
    if (!on) {
      if (document.pointerLockElement === this || this.shadowRoot?.pointerLockElement) document.exitPointerLock();
      return;
    }
    // If the browser refuses the lock, dragging turns the camera instead.
    Promise.resolve(this.canvas.requestPointerLock?.()).catch(() => undefined);
  }

  #onPointerLock() {
    if (!document.pointerLockElement && this.flight.mode) this.flight.setMode(false);
  }

  /**
   * @param {string} type
   * @param {unknown} detail
   */
  #emit(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }
}

if (!customElements.get('surfelcast-view')) customElements.define('surfelcast-view', SurfelcastView);
