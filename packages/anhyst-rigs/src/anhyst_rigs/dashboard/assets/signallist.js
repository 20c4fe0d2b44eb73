// The searchable list of signals: a tick shows a signal in the active plot, and a signal can be dragged into any panel.

import { DerivedForm } from "./derived.js";
import { make } from "./dom.js";
import { sign } from "./names.js";
import { hint, reading } from "./signals.js";
import { stroke } from "./strip.js";

const READ_MS = 200; // time between two updates of the values

export class SignalList {
  #due = 0;
  #rows = [];

  // `active` returns the plot in which ticks show signals.
  constructor(place, bench, store, order, active) {
    this.bench = bench;
    this.store = store;
    this.active = active;
    this.order = order;
    this.search = make("input", { type: "search", placeholder: "Search signals", id: "signal-search" });
    this.search.setAttribute("aria-label", "search signals");
    this.search.oninput = () => this.#filter();
    this.list = make("ul", { className: "scroll", id: "signal-list" });
    this.none = make("p", { className: "empty", textContent: "No signal has this name." });
    this.derived = new DerivedForm(bench, order);
    place.replaceChildren(this.search, this.list, this.none, this.derived.element);
    this.build();
  }

  build() {
    this.#rows = this.bench.signals.map((signal) => this.#row(signal));
    this.list.replaceChildren(...this.#rows.map((row) => row.element));
    this.#filter();
    this.#reveal(this.#rows.find(({ signal }) => signal.name === this.derived.awaited));
  }

  // Shows a signal that the user has added, in the list and in the active plot.
  #reveal(row) {
    if (!row) return;
    this.derived.awaited = null;
    this.search.value = "";
    this.#filter();
    this.active().add(row.signal.name);
    this.list.scrollTop = row.element.offsetTop;
  }

  #row(signal) {
    const { name, label, symbol, expression } = signal;
    const box = make("input", { type: "checkbox" });
    box.setAttribute("aria-label", name);
    box.onchange = () => this.active().toggle(name);
    const swatch = make("i", { className: "swatch" });
    swatch.style.background = stroke(signal);
    const value = make("output", { className: "reading" });
    const text = make("span", { className: "name", textContent: label }, sign(symbol));
    const element = make("li", { draggable: true, title: hint(signal) }, make("label", {}, box, swatch, text), value);
    element.dataset.signal = name;
    element.ondragstart = (event) => event.dataTransfer.setData("text/plain", name);
    if (expression) element.append(this.derived.removeButton(name));
    const words = [name, label, symbol, signal.unit, signal.doc].join(" ").toLowerCase();
    return { signal, box, value, element, words };
  }

  #filter() {
    const parts = this.search.value.toLowerCase().split(/\s+/);
    for (const { element, words } of this.#rows) element.hidden = !parts.every((part) => words.includes(part));
    this.none.hidden = this.#rows.some(({ element }) => !element.hidden);
  }

  // Shows the newest values, and the signals of the active plot.
  draw() {
    const now = performance.now();
    if (now < this.#due || !this.store.count) return;
    this.#due = now + READ_MS;
    const chosen = this.active().names;
    for (const { signal, box, value, element } of this.#rows) {
      box.checked = chosen.has(signal.name);
      if (element.hidden) continue;
      const newest = this.store.value(signal.column, this.store.count - 1);
      value.textContent = signal.expression && Number.isNaN(newest) ? "not finite" : reading(signal, newest, 4);
    }
  }
}
