/**
 * Says in words why there is no picture, or why it stands still: away, full, restarting, gone, no GPU. Counts down to
 * the next try. Screen readers hear each change once, not every second.
 */

/** @typedef {import('../connection/connection.js').ConnectionState} ConnectionState */

export class StatusCard {
  /** @type {ConnectionState} */
  #state = { kind: 'idle' };
  /** @type {{ title: string, detail: string } | undefined} */
  #note;
  #hasPicture = false;
  #spoken = '';
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
   * Something to say while the connection is fine.
   * @param {{ title: string, detail: string } | undefined} note
   */
  setNote(note) {
    this.#note = note;
    this.#render();
  }

  /** @param {boolean} has */
  setHasPicture(has) {
    if (has === this.#hasPicture) return;
    this.#hasPicture = has;
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
    card.classList.toggle('centred', !this.#hasPicture);
    if (!text) {
      this.#say(live, '');
      return;
    }
    title.textContent = text.title;
    detail.textContent = text.countdown ? `${text.detail} ${text.countdown}` : text.detail;
    action.hidden = text.action === undefined;
    action.textContent = text.action ?? '';
    this.#say(live, `${text.title}. ${text.detail}`);
    if (text.countdown) this.#timer = window.setTimeout(() => this.#render(), 1000);
  }

  /**
   * @param {HTMLElement} live
   * @param {string} text
   */
  #say(live, text) {
    if (text === this.#spoken) return;
    this.#spoken = text;
    live.textContent = text;
  }

  /** @returns {{ title: string, detail: string, countdown?: string, action?: string } | undefined} */
  #text() {
    const state = this.#state;
    switch (state.kind) {
      case 'idle':
        return undefined;
      case 'connecting':
        if (state.last) return { title: state.last.title, detail: state.last.detail, countdown: 'Trying now…' };
        return { title: 'Connecting', detail: 'Opening the stream from the render server…' };
      case 'waiting': {
        const seconds = Math.max(1, Math.ceil((state.retryAt - performance.now()) / 1000));
        return { ...state.last, countdown: `Next try in ${seconds} s.`, action: 'Try now' };
      }
      case 'stopped': {
        const actions = { superseded: 'Take it back', outdated: 'Reload', gone: undefined };
        const { kind } = state.last;
        return { ...state.last, action: kind in actions ? actions[/** @type {keyof typeof actions} */ (kind)] : 'Try again' };
      }
      case 'live':
        if (this.#note) return this.#note;
        return this.#hasPicture ? undefined : { title: 'Rendering the first picture', detail: 'The server is preparing the scene…' };
    }
  }
}
