// Two cursors on the scope, and statistics of the signals between them.

import { make } from "./dom.js";
import { seconds, show } from "./units.js";

const COLUMN_TITLES = ["", "A", "B", "dy", "rms", "rms about the mean"];

export class Cursors {
  ticks = []; // ticks of no, one or two cursors; A before B
  found = []; // statistics of each signal between both cursors
  #key = ""; // cursors and signals that are shown

  constructor(store, rate) {
    this.store = store;
    this.rate = rate;
    this.time = make("output", { className: "reading", id: "cursor-time" });
    this.rows = make("tbody");
    const head = make("tr", {}, ...COLUMN_TITLES.map((text) => make("th", { textContent: text })));
    this.table = make("table", {}, make("thead", {}, head), this.rows);
    const off = make("button", { textContent: "Remove cursors", onclick: () => (this.ticks = []) });
    const bar = make("div", { className: "bar" }, this.time, off);
    this.element = make("div", { id: "cursors", hidden: true }, bar, this.table);
  }

  // Sets cursor A, then B; each later call moves the nearer cursor. Cursors are on samples.
  put(time) {
    if (!this.store.count) return;
    const tick = this.#sampleAt(time * this.rate);
    this.#set(this.ticks.length < 2 ? this.ticks : [further(this.ticks, tick)], tick);
  }

  // Moves the cursor that was set last by some ticks.
  move(ticks) {
    const others = this.ticks.filter((tick) => tick !== this.last);
    if (others.length < this.ticks.length) this.#set(others, this.#sampleAt(this.last + ticks));
  }

  #set(others, tick) {
    this.last = tick;
    this.ticks = [...others, tick].sort((a, b) => a - b);
  }

  #sampleAt(tick) {
    const { store } = this;
    return store.tick(Math.min(store.find(tick), store.count - 1));
  }

  // Shows the statistics of signals; times are relative to the tick `zero`.
  show(signals, zero) {
    const key = [...this.ticks, zero, ...signals.map((one) => one.name)].join();
    if (this.#key === key || (!this.ticks.length && this.element.hidden)) return;
    this.#key = key;
    this.zero = zero;
    this.element.hidden = !this.ticks.length;
    this.time.textContent = this.#where();
    this.found = this.ticks.length < 2 ? [] : signals.map((one) => this.#between(one));
    this.rows.replaceChildren(
      ...this.#cells().map((cells) =>
        make("tr", {}, ...cells.map((cell) => make("td", { textContent: cell }))),
      ),
    );
    this.table.hidden = !this.found.length;
  }

  // Returns the cursor times and the statistics as lines of text.
  lines() {
    if (!this.ticks.length) return [];
    const figures = this.#cells().map((cells) =>
      cells.map((cell, n) => (n ? `${COLUMN_TITLES[n]} ${cell}` : cell)).join("  "),
    );
    return [this.#where(), ...figures];
  }

  #cells() {
    return this.found.map(({ label, unit, a, b, dy, rms, ripple }) => [
      label,
      ...[a, b, dy, rms, ripple].map((value) => show(value, unit)),
    ]);
  }

  // Returns the times of the cursors as a line of text.
  #where() {
    const [a, b] = this.ticks.map((tick) => (tick - this.zero) / this.rate);
    if (a === undefined) return "";
    if (b === undefined) return `A ${seconds(a)}; click again for B`;
    const apart = b > a ? `dt ${seconds(b - a)}, 1/dt ${Number((1 / (b - a)).toPrecision(6))} Hz` : "dt 0";
    return `A ${seconds(a)}, B ${seconds(b)}, ${apart}`;
  }

  // Returns the statistics of a signal from A to B, inclusive; missing ticks are ignored.
  #between({ label, unit, column }) {
    const { store } = this;
    const [first, last] = this.ticks.map((tick) => store.find(tick));
    const mean = (of) => {
      let sum = 0;
      let count = 0;
      for (let row = first; row <= last; row++) {
        const value = of(store.value(column, row));
        if (value !== value) continue;
        sum += value;
        count++;
      }
      return sum / count;
    };
    const [a, b] = [first, last].map((row) => store.value(column, row));
    const middle = mean((value) => value);
    const rms = Math.sqrt(mean((value) => value * value));
    const ripple = Math.sqrt(mean((value) => (value - middle) ** 2));
    return { label, unit, a, b, dy: b - a, rms, ripple };
  }
}

function further(ticks, tick) {
  const [a, b] = ticks;
  return Math.abs(a - tick) <= Math.abs(b - tick) ? b : a;
}
