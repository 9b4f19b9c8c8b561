/** A quantity per second over the last second, e.g. bytes or frames. */
export class Rate {
  /** @type {{ at: number, amount: number }[]} oldest first */
  #entries = [];
  #sum = 0;

  /**
   * @param {number} at milliseconds
   * @param {number} amount
   */
  add(at, amount) {
    this.#entries.push({ at, amount });
    this.#sum += amount;
    this.#expire(at);
  }

  /** @param {number} now milliseconds */
  perSecond(now) {
    this.#expire(now);
    return this.#sum;
  }

  /** @param {number} now */
  #expire(now) {
    while (this.#entries[0] && this.#entries[0].at <= now - 1000) this.#sum -= this.#entries.shift()?.amount ?? 0;
    if (this.#entries.length === 0) this.#sum = 0;
  }
}
