/**
 * The full page: wires the view to its panels. Query parameters: `scene` (id or name), `max_spp`, `resolution`.
 */

import '../view/surfelcast-view.js';
import { byId } from './dom.js';
import { Hud } from './hud.js';
import { InspectorPanel } from './inspector-panel.js';
import { LightsPanel } from './lights-panel.js';
import { ScenePanel } from './scene-panel.js';
import { StatsPanel } from './stats-panel.js';
import { wireTabs } from './tabs.js';
import { Toasts } from './toast.js';
import { ViewPanel } from './view-panel.js';

/** Wait before the list of scenes is requested again from a server that does not answer. */
const LIST_RETRY_MS = 3000;

const query = new URLSearchParams(location.search);
/** @type {import('../view/surfelcast-view.js').SurfelcastView} */
const view = byId('view');
for (const [parameter, attribute] of /** @type {const} */ ([['max_spp', 'max-spp'], ['resolution', 'resolution']])) {
  const value = query.get(parameter);
  if (value !== null) view.setAttribute(attribute, value);
}

const toasts = new Toasts(byId('toasts'));
const viewPanel = new ViewPanel(byId('view-panel'), view);
const lightsPanel = new LightsPanel(byId('lights-panel'), view);
const statsPanel = new StatsPanel(byId('stats-panel'));
const hud = new Hud(byId('hud'), view, statsPanel);
const scenes = new ScenePanel(
  { select: byId('scene'), button: byId('upload'), input: byId('file'), dropZone: byId('drop'), progress: byId('progress') },
  toasts,
  (path) => {
    view.src = path;
  },
);
const openPanel = wireTabs(byId('sheet'));
const inspector = new InspectorPanel(byId('panel-inspect'), view, { toasts, reveal: () => openPanel('view') });

/**
 * Listens to an event of the view.
 * @template T
 * @param {string} type
 * @param {(detail: T) => void} listener
 */
function on(type, listener) {
  view.addEventListener(type, (event) => listener(/** @type {CustomEvent<T>} */ (event).detail));
}

let sceneShown = '';
on('welcome', (/** @type {import('../protocol/types.js').Welcome} */ welcome) => {
  if (welcome.session.id !== sceneShown) {
    sceneShown = welcome.session.id;
    lightsPanel.clear();
    hud.clear();
    inspector.clear();
  }
  document.title = `${welcome.session.scene_name} · surfelcast`;
  viewPanel.update(welcome);
  statsPanel.welcome(welcome);
});
on('lights', (/** @type {Extract<import('../protocol/types.js').ServerMessage, { t: 'lights' }>} */ state) => lightsPanel.update(state));
on('frame', (/** @type {import('../protocol/frame.js').FrameHeader} */ frame) => {
  hud.frame(frame);
  statsPanel.frame(frame);
  lightsPanel.catchUp(frame.inputSeq);
});
on('stats', (/** @type {import('../protocol/types.js').Stats} */ stats) => {
  hud.stats(stats);
  statsPanel.stats(stats);
});
on('inspecting', (/** @type {{ on: boolean, waiting: boolean }} */ mode) => {
  viewPanel.inspecting(mode.on);
  inspector.mode(mode);
});
on('inspected', (/** @type {import('../view/surfelcast-view.js').Answer} */ answer) => inspector.show(answer));
on('pose', (/** @type {{ resting: boolean }} */ { resting }) => hud.moving(!resting));
on('refused', (/** @type {Extract<import('../protocol/types.js').ServerMessage, { t: 'error' }>} */ refusal) => {
  toasts.show(refusal.detail, 'error');
  lightsPanel.catchUp();
});
on('state', (/** @type {import('../connection/connection.js').ConnectionState} */ state) => {
  document.body.dataset['connection'] = state.kind;
  hud.live(state.kind === 'live');
  for (const fields of document.querySelectorAll('fieldset.needs-server')) {
    /** @type {HTMLFieldSetElement} */ (fields).disabled = state.kind !== 'live';
  }
  // After a restart of the server the scene has another session.
  if (state.kind === 'waiting' || (state.kind === 'stopped' && state.last.kind === 'gone')) void scenes.recover();
});

byId('screenshot').addEventListener('click', async () => {
  try {
    const url = URL.createObjectURL(await view.capture());
    const link = document.createElement('a');
    link.href = url;
    const name = view.welcome?.session.scene_name ?? 'view';
    link.download = `surfelcast-${name.replace(/[^\p{L}\p{N}]+/gu, '-').toLowerCase()}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  } catch (error) {
    toasts.show(`The image could not be saved: ${/** @type {Error} */ (error).message}`, 'error');
  }
});

/** @type {HTMLDialogElement} */
const help = byId('help');
byId('help-open').addEventListener('click', () => help.showModal());
help.addEventListener('click', (event) => {
  if (event.target === help) help.close();
});

async function begin() {
  try {
    await scenes.load(query.get('scene') ?? undefined);
    byId('away').hidden = true;
    byId('empty').hidden = scenes.scenes.length > 0;
  } catch (error) {
    byId('away').hidden = false;
    byId('away-detail').textContent = /** @type {Error} */ (error).message;
    setTimeout(() => void begin(), LIST_RETRY_MS);
  }
}
void begin();
