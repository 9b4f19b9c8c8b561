/**
 * One connection to the fake server: answers as a session does, draws images whose colour follows the camera and the
 * lights, keeps to an acknowledgement window, and stops sending when it has "converged".
 */

import { encodeFrame, FLAGS } from './frame.js';
import { png } from './png.js';

const WINDOW = 2;
const STILL_AFTER_MS = 150;

export class FakeSession {
  frameSeq = 0;
  acked = 0;
  inputSeq = 0;
  size = [0, 0];
  paused = false;
  exposure = 1;
  /** Output shown instead of radiance. @type {string | null} */
  aov = null;
  /** Inspections to be answered. @type {any[]} */
  held = [];
  pose = undefined;
  dirty = false;
  /** Rounds of refinement left: still, refined, final. */
  refinements = 0;
  timer = undefined;
  /** Time at which the view is at rest, or the next refinement is due. */
  restAt = 0;

  /**
   * @param {import('ws').WebSocket} socket
   * @param {import('./fake-server.js').FakeServer} server
   * @param {boolean} other whether of the second scene
   */
  constructor(socket, server, other) {
    this.other = other;
    this.socket = socket;
    this.server = server;
    socket.on('message', (data) => this.onMessage(JSON.parse(String(data))));
    socket.on('close', () => clearTimeout(this.timer));
  }

  send(message) {
    if (this.socket.readyState === 1) this.socket.send(JSON.stringify(message));
  }

  onMessage(message) {
    this.server.messages.push(message);
    switch (message.t) {
      case 'hello':
        if (this.server.closeWith) {
          this.socket.close(this.server.closeWith, 'as the test requests');
          return;
        }
        this.send(this.server.welcome(this.other));
        this.sendLights();
        break;
      case 'view.set':
        if (message.w && message.h) this.size = [message.w, message.h];
        this.paused = message.paused ?? this.paused;
        this.exposure = message.exposure ?? this.exposure;
        if (message.aov !== undefined) this.aov = message.aov;
        this.touch();
        break;
      case 'camera':
        this.inputSeq = message.seq;
        this.pose = message.pose;
        this.touch();
        break;
      case 'light':
        this.inputSeq = message.seq;
        this.server.editLights(message.patch);
        this.sendLights();
        this.touch();
        break;
      case 'pick':
        this.send({ t: 'picked', re: message.id, position: [0.25, 0.5, -0.1], object: 'tall box' });
        break;
      case 'inspect':
        this.held.push(message);
        if (!this.server.holdInspections) this.answerInspections();
        break;
      case 'ack':
        this.acked = message.seq;
        this.pump();
        break;
      case 'ping':
        this.send({ t: 'pong', ts: message.ts, server_ms: performance.now() });
        break;
    }
  }

  answerInspections() {
    for (const { id } of this.held.splice(0)) {
      if (this.server.inspectRefusal) this.send({ t: 'error', re: id, ...this.server.inspectRefusal });
      else this.send({ t: 'inspected', re: id, inspection: this.server.inspection });
    }
  }

  sendLights() {
    this.send({ t: 'lights', scene_rev: 1, ...this.server.lights });
  }

  /** Something changed: a quick frame now, refinement after a pause. */
  touch() {
    this.dirty = true;
    this.refinements = 3;
    this.restAt = performance.now() + STILL_AFTER_MS;
    this.wakeAtRest();
    this.pump();
  }

  wakeAtRest() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.pump(), Math.ceil(this.restAt - performance.now()) + 1);
  }

  /** Sends the frame that is due, if the window is open; every acknowledgement calls it. */
  pump() {
    if (this.paused || this.size[0] === 0 || this.frameSeq - this.acked >= WINDOW || this.server.silent) return;
    if (this.dirty) {
      this.dirty = false;
      this.sendFrame(0, 2);
      this.send(this.server.stats(false));
      return;
    }
    if (this.refinements === 0) return;
    if (performance.now() < this.restAt) {
      this.wakeAtRest();
      return;
    }
    this.refinements -= 1;
    const last = this.refinements === 0;
    this.sendFrame(FLAGS.STILL | (last ? FLAGS.FINAL | FLAGS.LOSSLESS : 0), last ? 1 : 2);
    this.send(this.server.stats(last));
    this.restAt = performance.now() + STILL_AFTER_MS;
    if (!last) this.wakeAtRest();
  }

  sendFrame(flags, divisor) {
    this.frameSeq += 1;
    const size = this.server.image ? this.server.image.size : this.size.map((side) => Math.max(1, Math.round(side / divisor / 4)));
    const payload = this.server.image?.payload ?? this.draw(size);
    const samples = flags & FLAGS.FINAL ? 256 : flags & FLAGS.STILL ? 64 : 1;
    const frame = { payload, frameSeq: this.frameSeq, inputSeq: this.inputSeq, size, fullSize: this.size, flags: flags | 1, samples };
    if (this.socket.readyState === 1) this.socket.send(encodeFrame(frame));
  }

  /** A wall and a floor, tinted by where the camera is and how bright the lights are; green for any other output. */
  draw([width, height]) {
    if (this.aov) return png(width, height, () => [20, 200, 40]);
    const [x, y, z] = this.pose?.eye ?? [0, 1, 3.5];
    const bright = Math.min(1, (0.4 + 0.2 * this.server.lights.lights.filter(({ enabled }) => enabled).length) * this.exposure);
    const azimuth = (Math.atan2(x, z) / Math.PI + 1) * 127;
    const elevation = 90 + 80 * Math.tanh(y - 1);
    return png(width, height, (px, py) => {
      const shade = bright * (py > height * 0.62 ? 0.55 : 1) * (0.75 + (0.25 * px) / width);
      return [azimuth * shade, elevation * shade, 150 * shade];
    });
  }
}
