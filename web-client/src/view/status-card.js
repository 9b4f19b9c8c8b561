/**
 * States why there is no image, or why it does not change: away, full, restarting, gone, no GPU. Counts down to the
 * next attempt. Screen readers announce each change once, not every second.
 */

/** @typedef {import('../connection/connection.js').ConnectionState} ConnectionState */

export class StatusCard {
  /** @type {ConnectionState} */
  #state = { kind: 'idle' };
  /** @type {{ title: string, detail: string } | undefined} */
  #note;
  #hasImage = false;
  #announced = '';
  /** @type {number | undefined} */
  #timer;

  /**
   * @param {object} parts
   * @param {HTMLElement} parts.card
   * @param {HTMLElement} parts.title
   * @param {HTMLElement} parts.detail
   * @param {HTMLButtonElement} parts.action
   * @param {HTMLElement} parts.live region for screen readers
   */
  constructor(parts) {
    this.parts = parts;
  }

  /** @param {ConnectionState} state */
  setState(state) {
    this.#state = state;
    this.#render();
  }

  /**
   * A message to show while the connection is live.
   * @param {{ title: string, detail: string } | undefined} note
   */
  setNote(note) {
    this.#note = note;
    this.#render();
  }

  /** @param {boolean} has */
  setHasImage(has) {
    if (has === this.#hasImage) return;
    this.#hasImage = has;
    this.#render();
  }

  dispose() {
    clearTimeout(this.#timer);
  }

  #render() {
    clearTimeout(this.#timer);
    const { card, title, detail, action, live } = this.parts;
    const text = this.#text();
    card.hidden = text === undefined;
    card.classList.toggle('centred', !this.#hasImage);
    if (!text) {
      this.#announce(live, '');
      return;
    }
    title.textContent = text.title;
    detail.textContent = text.countdown ? `${text.detail} ${text.countdown}` : text.detail;
    action.hidden = text.action === undefined;
    action.textContent = text.action ?? '';
    this.#announce(live, `${text.title}. ${text.detail}`);
    if (text.countdown) this.#timer = window.setTimeout(() => this.#render(), 1000);
  }

  /**
   * @param {HTMLElement} live
   * @param {string} text
   */
  #announce(live, text) {
    if (text === this.#announced) return;
    this.#announced = text;
    live.textContent = text;
  }

  /** @returns {{ title: string, detail: string, countdown?: string, action?: string } | undefined} */
  #text() {
    const state = this.#state;
    switch (state.kind) {
      case 'idle':
        return undefined;
      case 'connecting':
        if (state.last) return { title: state.last.title, detail: state.last.detail, countdown: 'Connecting now…' };
        return { title: 'Connecting', detail: 'Opening the stream from the render server…' };
      case 'waiting': {
        const seconds = Math.max(1, Math.ceil((state.retryAt - performance.now()) / 1000));
        return { ...state.last, countdown: `Next attempt in ${seconds} s.`, action: 'Try now' };
      }
      case 'stopped': {
        const actions = { superseded: 'Resume here', outdated: 'Reload', gone: undefined };
        const { kind } = state.last;
        return { ...state.last, action: kind in actions ? actions[/** @type {keyof typeof actions} */ (kind)] : 'Try again' };
      }
      case 'live':
        if (this.#note) return this.#note;
        return this.#hasImage ? undefined : { title: 'Rendering the first frame', detail: 'The server is preparing the scene…' };
    }
  }
}
