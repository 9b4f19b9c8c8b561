/**
 * A server without GPU that speaks the protocol: for tests of the page, and for work on the client
 * (`node support/fake-server.js`).
 */

import { createServer } from 'node:http';
import { WebSocketServer } from 'ws';
import { serveFile } from './static-files.js';
import { FakeSession } from './fake-session.js';

const SCENE = `sha256:${'ab'.repeat(32)}`;
const OTHER = `sha256:${'cd'.repeat(32)}`;

const LIMITS = {
  control_bytes: 65536,
  hello_bytes: 16384,
  hello_timeout_ms: 5000,
  inputs_per_sec: 240,
  max_side: 4096,
  max_pixels: 8_300_000,
  views_per_session: 32,
  max_lights: 256,
};

/**
 * The inspection of a point lit by `count` surfels.
 * @param {number} count
 */
export function inspectionOf(count) {
  const light = [[0.5, 0.4, 0.3], [0.125, 0.1, 0.05]];
  const columns = [['id', 'Surfel'], ['share', 'Share', 'share'], ['ray_count', 'Rays', 'count'], ['radius', 'Radius', 'm'], ['std_error', 'Error'],
    ['direct', 'Direct'], ['indirect', 'Indirect']];
  const rows = Array.from({ length: count }, (_, i) => ({
    values: [120_000 - 17 * i, (2 * (count - i)) / (count * (count + 1)), 4096 / (i + 1), 0.062 / (i + 1), 0.0021 * (i + 1), ...light],
    disc: { position: [0.25 + 0.01 * i, 0, -0.1], normal: [0, 1, 0], radius: 0.062 / (i + 1) },
  }));
  return {
    position: [0.25, 0, -0.125],
    normal: [0, 1, 0],
    headline: count === 1 ? '1 surfel lights this point.' : `${count} surfels light this point.`,
    summary: [
      { id: 'coverage', label: 'Coverage', value: 1.25 },
      { id: 'trust', label: 'Trust', value: 0.75 },
      { id: 'light', label: 'Irradiance / π', value: [0.625, 0.5, 0.35] },
      { id: 'direct', label: 'Direct', value: light[0] },
      { id: 'indirect', label: 'Indirect', value: light[1] },
    ],
    columns: columns.map(([id, label, unit]) => ({ id, label, ...(unit ? { unit } : {}) })),
    rows,
  };
}

/** Settings of the fake server's second technique: one of each kind. */
const SETTINGS = [
  { id: 'radius', label: 'Radius', help: 'Smaller shows more detail.', unit: 'pixels', kind: 'number', default: 5, range: [1.5, 32] },
  { id: 'depth', label: 'Depth', help: 'Respects walls.', kind: 'switch', default: true },
  { id: 'grid', label: 'Grid', help: 'How records are found.', kind: 'choice', default: 'cascades', names: ['cascades', 'trapezoidal'] },
];

export class FakeServer {
  /** Every control message received, in order. @type {any[]} */
  messages = [];
  /** Close code to answer `hello` with. @type {number | undefined} */
  closeWith;
  /** No frames while true. */
  silent = false;
  /** Answer to `GET /v1/scenes` with a problem. @type {any} */
  problem;
  /** Answer to uploads. @type {{ status: number, body: any } | undefined} */
  uploadAnswer;
  /** Answer to inspections; null for nothing. @type {any} */
  inspection = inspectionOf(24);
  /** Refusal of inspections, instead. @type {{ code: string, detail: string } | undefined} */
  inspectRefusal;
  /** Inspections wait for `FakeSession.answerInspections` while true. */
  holdInspections = false;
  /** Image to send instead of the drawn one. @type {{ payload: Buffer, size: [number, number] } | undefined} */
  image;
  session = 'session-1';
  conn = 0;
  lights = {
    lights: [
      { id: 1, name: 'Sun', kind: 'directional', position: [0, 0, 0], direction: [0.5, -1, 0.25], color: [1, 0.95, 0.8], intensity: 3.5, enabled: true },
      { id: 2, name: 'Desk lamp', kind: 'spot', position: [0.5, 1.8, 0], direction: [0, -1, 0], color: [1, 0.8, 0.5], intensity: 25, cone_deg: [20, 40], enabled: true },
    ],
    environment_strength: 1,
    emissive_strength: 1,
    has_environment: true,
  };

  /** @param {number} [port] 0 chooses one */
  async start(port = 0) {
    this.http = createServer((request, response) => this.#answer(request, response));
    const sockets = new WebSocketServer({ noServer: true, handleProtocols: () => 'surfelcast.v1.json' });
    this.sockets = sockets;
    this.http.on('upgrade', (request, socket, head) => {
      if (![`/v1/sessions/${this.session}/stream`, '/v1/sessions/other/stream'].includes(request.url ?? '')) {
        socket.end('HTTP/1.1 404 Not Found\r\nconnection: close\r\n\r\n');
        return;
      }
      sockets.handleUpgrade(request, socket, head, (ws) => {
        this.client = new FakeSession(ws, this, (request.url ?? '').includes('/other/'));
      });
    });
    await new Promise((resolve, reject) => {
      this.http.once('error', reject);
      this.http.listen(port, '127.0.0.1', () => resolve(undefined));
    });
    this.port = this.http.address().port;
    this.address = `http://127.0.0.1:${this.port}`;
    return this;
  }

  /** Closes everything at once, as a killed process does. */
  async kill() {
    for (const socket of this.sockets.clients) socket.terminate();
    this.http.closeAllConnections();
    await new Promise((resolve) => this.http.close(resolve));
  }

  /** Messages of a type. */
  received(type) {
    return this.messages.filter(({ t }) => t === type);
  }

  /** @param {boolean} other whether for the second scene */
  welcome(other) {
    this.conn += 1;
    /** @param {any[]} eye */
    const pose = (eye) => ({ eye, target: [0, 1, 0], up: [0, 1, 0], vfov_deg: 40 });
    return {
      t: 'welcome',
      v: 1,
      conn: `c${this.conn}`,
      session: other
        ? { id: 'other', scene: OTHER, scene_name: 'Interior', scene_rev: 1, epoch: 0, triangle_count: 120_000 }
        : { id: this.session, scene: SCENE, scene_name: 'Cornell box', scene_rev: 1, epoch: 0, triangle_count: 34 },
      limits: LIMITS,
      techniques: [
        { id: 'path', label: 'Path tracing', summary: 'Unbiased reference with multiple importance sampling.' },
        {
          id: 'cache',
          label: 'Cache',
          summary: 'Persistent cache of indirect light.',
          settings: SETTINGS,
          presets: [{ id: 'high', values: { radius: 3, grid: 'trapezoidal' } }],
        },
      ],
      outputs: [
        { id: 'normal', label: 'Normal' },
        { id: 'variance', label: 'Variance', help: 'Variance of the mean.' },
        { id: 'cache_coverage', label: 'Coverage', help: 'Sum of weights.', technique: 'cache' },
      ],
      cameras: other ? [] : [
        { name: 'front', pose: pose([0, 1, 3.5]), exposure: 1 },
        { name: 'corner', pose: pose([2, 1.6, 2.6]), exposure: 1 },
      ],
      center: [0, 1, 0],
      radius: 1.75,
      warnings: ['KHR_materials_clearcoat is not supported and was ignored'],
      server_ms: performance.now(),
      resume_token: `token-${this.conn}`,
      grace_ms: 120000,
      server: 'surfelcast/0.1.0',
      device: 'Fake device',
    };
  }

  stats(converged) {
    return {
      t: 'stats',
      view: 0,
      quality: 72,
      scale: 0.5,
      fps: 24,
      window: 2,
      rtt_ms: 3.2,
      reason: 'device',
      samples: converged ? 256 : 64,
      error: { rmse: converged ? 0.0062 : 0.0131, std_error: 0.0008 },
      converged,
      passes: [
        { name: 'primary_rays', ms: 2.1 },
        { name: 'path_extend', ms: 5.4 },
        { name: 'accumulate', ms: 0.4 },
        { name: 'tone_map', ms: 0.3 },
      ],
      skipped: [{ name: 'alpha_mask', reason: 'no alpha in the scene' }],
    };
  }

  editLights(patch) {
    const state = this.lights;
    if (patch.add) state.lights.push({ ...patch.add, id: 1 + Math.max(0, ...state.lights.map(({ id }) => id)) });
    if (patch.set) state.lights = state.lights.map((light) => (light.id === patch.set.id ? patch.set : light));
    if (patch.remove !== undefined) state.lights = state.lights.filter(({ id }) => id !== patch.remove);
    state.environment_strength = patch.environment_strength ?? state.environment_strength;
    state.emissive_strength = patch.emissive_strength ?? state.emissive_strength;
  }

  #answer(request, response) {
    const path = new URL(request.url ?? '/', 'http://localhost').pathname;
    const reply = (status, body, type = 'application/json') => {
      response.writeHead(status, { 'content-type': type });
      response.end(JSON.stringify(body));
    };
    if (path === '/v1/scenes' && request.method === 'GET') {
      if (this.problem) reply(this.problem.status, this.problem, 'application/problem+json');
      else reply(200, { scenes: this.#scenes() });
    } else if (path === '/v1/scenes' && request.method === 'POST') {
      request.resume();
      request.on('end', () => {
        const { status, body } = this.uploadAnswer ?? { status: 201, body: this.#scenes()[1] };
        reply(status, body, status < 400 ? 'application/json' : 'application/problem+json');
      });
    } else if (path === '/v1/openapi.json') {
      reply(200, this.openapi ?? { openapi: '3.1.0', info: { title: 'surfelcast', version: '0.1.0' }, paths: {} });
    } else {
      void serveFile(path, response);
    }
  }

  #scenes() {
    const common = { triangle_count: 34, cameras: ['front', 'corner'], warnings: [] };
    return [
      { id: SCENE, name: 'Cornell box', session: this.session, ...common },
      { id: OTHER, name: 'Interior', session: 'other', ...common, triangle_count: 120_000 },
    ];
  }
}

if (process.argv[1] && import.meta.url.endsWith(process.argv[1].split('/').at(-1) ?? '')) {
  const server = await new FakeServer().start(Number(process.env.PORT ?? 8088));
  console.log(`fake server at ${server.address}`);
}
