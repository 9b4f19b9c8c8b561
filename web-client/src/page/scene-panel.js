/**
 * The choice of scene, and uploads by file picker or by dropping a file anywhere on the page.
 */

import { h } from './dom.js';
import { listScenes, ServiceError, streamPath, uploadScene } from './scene-service.js';

/** @typedef {import('./scene-service.js').Scene} Scene */

export class ScenePanel {
  /** @type {Scene[]} */
  #scenes = [];
  /** @type {Scene | undefined} */
  #chosen;
  /** @type {AbortController | undefined} */
  #upload;

  /**
   * @param {object} parts
   * @param {HTMLSelectElement} parts.select
   * @param {HTMLButtonElement} parts.button
   * @param {HTMLInputElement} parts.input of type file
   * @param {HTMLElement} parts.dropZone shown while a file hovers over the page
   * @param {HTMLElement} parts.progress host of the progress bar of an upload
   * @param {import('./toast.js').Toasts} toasts
   * @param {(path: string) => void} choose opens the stream of a session
   */
  constructor(parts, toasts, choose) {
    this.parts = parts;
    this.toasts = toasts;
    this.choose = choose;
    const { select, button, input } = parts;
    select.addEventListener('change', () => this.#choose(this.#scenes.find(({ id }) => id === select.value)));
    button.addEventListener('click', () => input.click());
    input.addEventListener('change', () => {
      const file = input.files?.[0];
      input.value = '';
      if (file) void this.#send(file);
    });
    this.#listenToDrops();
  }

  /** Known scenes. */
  get scenes() {
    return this.#scenes;
  }

  /**
   * Loads the list and opens a scene of it.
   * @param {string} [wanted] id or name of the scene to open; the first one otherwise
   * @throws {ServiceError}
   */
  async load(wanted) {
    await this.#refresh();
    this.#choose(this.#scenes.find(({ id, name }) => id === wanted || name === wanted) ?? this.#scenes[0]);
  }

  /**
   * After a restart of the server the same scene has another session: finds and opens it.
   * @returns {Promise<boolean>} whether there was such a session
   */
  async recover() {
    const before = this.#chosen;
    try {
      await this.#refresh();
    } catch {
      return false;
    }
    const now = this.#scenes.find(({ id }) => id === before?.id) ?? (before ? undefined : this.#scenes[0]);
    if (!now || now.session === before?.session) return false;
    this.#choose(now);
    return true;
  }

  async #refresh() {
    this.#scenes = await listScenes();
    this.#render();
  }

  #render() {
    const { select } = this.parts;
    select.replaceChildren(
      ...this.#scenes.map(({ id, name }) => h('option', { value: id }, name)),
    );
    select.disabled = this.#scenes.length === 0;
    if (this.#scenes.length === 0) select.append(h('option', {}, 'No scenes yet'));
    if (this.#chosen) select.value = this.#chosen.id;
  }

  /** @param {Scene | undefined} scene */
  #choose(scene) {
    if (!scene) return;
    this.#chosen = scene;
    this.parts.select.value = scene.id;
    this.choose(streamPath(scene.session));
  }

  /** @param {File} file */
  async #send(file) {
    if (this.#upload) {
      this.toasts.show('An upload is already running. Wait for it, or cancel it.', 'error');
      return;
    }
    if (!/\.glb$/i.test(file.name)) {
      this.toasts.show(`${file.name} is not a .glb file. Export the scene as binary glTF (GLB) and try again.`, 'error');
      return;
    }
    const upload = new AbortController();
    this.#upload = upload;
    const bar = h('progress', { max: 1, value: 0, 'aria-label': `Uploading ${file.name}` });
    const text = h('span', {}, `Uploading ${file.name}`);
    const cancel = h('button', { type: 'button', className: 'quiet', textContent: 'Cancel', onclick: () => upload.abort() });
    this.parts.progress.replaceChildren(text, bar, cancel);
    this.parts.progress.hidden = false;
    try {
      const scene = await uploadScene(
        file,
        (fraction) => {
          bar.value = fraction;
          if (fraction < 1) return;
          bar.removeAttribute('value');
          text.textContent = `Preparing ${file.name}`;
        },
        upload.signal,
      );
      if (!this.#scenes.some(({ id }) => id === scene.id)) this.#scenes = [...this.#scenes, scene];
      this.#render();
      this.#choose(scene);
    } catch (error) {
      if (!upload.signal.aborted) this.toasts.show(error instanceof ServiceError ? error.message : String(error), 'error');
    } finally {
      this.#upload = undefined;
      this.parts.progress.hidden = true;
    }
  }

  #listenToDrops() {
    const { dropZone } = this.parts;
    /** @param {DragEvent} event */
    const carriesFile = (event) => event.dataTransfer?.types.includes('Files') ?? false;
    // Enter and leave fire for every element under the pointer.
    let depth = 0;
    addEventListener('dragenter', (event) => {
      if (!carriesFile(event)) return;
      depth += 1;
      dropZone.hidden = false;
    });
    addEventListener('dragleave', (event) => {
      if (!carriesFile(event)) return;
      depth = Math.max(0, depth - 1);
      dropZone.hidden = depth === 0;
    });
    addEventListener('dragover', (event) => {
      if (carriesFile(event)) event.preventDefault();
    });
    addEventListener('drop', (event) => {
      if (!carriesFile(event)) return;
      event.preventDefault();
      depth = 0;
      dropZone.hidden = true;
      const file = event.dataTransfer?.files[0];
      if (file) void this.#send(file);
    });
  }
}
