/**
 * Statistics of the view: rates measured here, and times of the server by pass.
 */

import { h } from './dom.js';
import { auditedError, bytes, count, milliseconds, reasonText } from './format.js';

const ROWS = /** @type {const} */ ({
  error: 'Error',
  samples: 'Samples per pixel',
  size: 'Image',
  fps: 'Frames per second',
  latency: 'Input to photon, p50 / p95',
  bandwidth: 'Received per second',
  frame: 'Render / encode',
  rtt: 'Round trip',
  moving: 'While moving',
  triangles: 'Triangles',
  device: 'Device',
  server: 'Server',
});

/** Times in the frame header saturate here. */
const MOST_MS = 655.35;

/** @param {number} ms */
const headerTime = (ms) => (ms >= MOST_MS ? `over ${milliseconds(MOST_MS)}` : milliseconds(ms));

/** @typedef {import('../protocol/types.js').Stats} Stats */
/** @typedef {import('../protocol/frame.js').FrameHeader} FrameHeader */

export class StatsPanel {
  /** @type {Record<string, HTMLElement>} */
  #values = {};

  /** @param {HTMLElement} host */
  constructor(host) {
    const list = h('dl', { className: 'figures' });
    for (const [key, label] of Object.entries(ROWS)) {
      const value = h('dd', { textContent: '–' });
      this.#values[key] = value;
      list.append(h('div', {}, h('dt', {}, label), value));
    }
    this.passes = h('table', { className: 'passes', hidden: true });
    this.skipped = h('details', { className: 'skipped', hidden: true });
    host.append(list, this.passes, this.skipped);
  }

  /** @param {import('../protocol/types.js').Welcome} welcome */
  welcome(welcome) {
    this.#set('triangles', count(welcome.session.triangle_count));
    this.#set('device', welcome.device);
    this.#set('server', welcome.server);
    for (const key of /** @type {const} */ (['error', 'samples', 'frame', 'rtt', 'moving'])) this.#set(key, '–');
    this.passes.hidden = true;
    this.skipped.hidden = true;
  }

  /** @param {FrameHeader} frame */
  frame(frame) {
    const [width, height] = frame.fullSize;
    const [, , w, h_] = frame.rect;
    const reduced = w !== width || h_ !== height;
    this.#set('size', `${width} × ${height}${reduced ? ` from ${w} × ${h_}` : ''} ${frame.codec.toUpperCase()}`);
    this.#set('samples', count(frame.samples));
    this.#set('frame', `${headerTime(frame.renderMs)} / ${headerTime(frame.encodeMs)}`);
  }

  /** @param {ReturnType<import('../view/surfelcast-view.js').SurfelcastView['measure']>} measured */
  measured({ framesPerSecond, bytesPerSecond, latency }) {
    this.#set('fps', count(framesPerSecond));
    this.#set('bandwidth', bytes(bytesPerSecond));
    this.#set('latency', latency ? `${milliseconds(latency.p50)} / ${milliseconds(latency.p95)}` : '–');
  }

  /** @param {Stats} stats */
  stats(stats) {
    this.#set('error', stats.error ? auditedError(stats.error) : '–');
    this.#set('samples', count(stats.samples));
    this.#set('rtt', stats.rtt_ms > 0 ? milliseconds(stats.rtt_ms) : '–');
    const moving = `quality ${stats.quality}, ${Math.round(stats.scale * 100)} % resolution`;
    this.#set('moving', stats.reason ? `${moving}: ${reasonText(stats.reason)}` : moving);
    this.#showPasses(stats.passes);
    this.skipped.hidden = stats.skipped.length === 0;
    this.skipped.replaceChildren(
      h('summary', {}, `${count(stats.skipped.length)} passes not needed`),
      h('ul', {}, ...stats.skipped.map(({ name, reason }) => h('li', {}, h('code', {}, name), ` ${reason}`))),
    );
  }

  /** @param {Stats['passes']} passes */
  #showPasses(passes) {
    this.passes.hidden = passes.length === 0;
    const total = passes.reduce((sum, { ms }) => sum + ms, 0);
    const rows = passes.map(({ name, ms }) => {
      const bar = h('meter', { min: 0, max: Math.max(total, 1e-6), value: ms, 'aria-hidden': 'true' });
      return h('tr', {}, h('th', { scope: 'row' }, name), h('td', { className: 'share' }, bar), h('td', {}, milliseconds(ms)));
    });
    this.passes.replaceChildren(
      h('caption', {}, h('span', {}, 'Passes of the newest frame'), h('span', {}, milliseconds(total))),
      h('tbody', {}, ...rows),
    );
  }

  /**
   * @param {keyof typeof ROWS} key
   * @param {string} text
   */
  #set(key, text) {
    const value = this.#values[key];
    // Writing an equal text would invalidate the layout.
    if (value && value.textContent !== text) value.textContent = text;
  }
}
