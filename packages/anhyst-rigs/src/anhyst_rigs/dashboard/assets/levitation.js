// The levitation view: position and position noise of the armature in large type.

import { Plane, limits } from "./canvas.js";
import { BLUE } from "./colours.js";
import { make } from "./dom.js";
import { words } from "./names.js";
import { columnOf, phaseColumn } from "./signals.js";
import { fine, shown } from "./units.js";

const WINDOW_S = 0.5; // time window, in which the reference must be constant
const UPDATE_INTERVAL_MS = 100;

export class LevitationView {
  #due = 0;

  constructor(place, bench, store) {
    this.bench = bench;
    this.store = store;
    const find = (name) => columnOf(bench, name);
    const { signal, reference, unit } = bench.aim;
    this.columns = {
      actual: find(signal),
      reference: find(reference),
      read: find(`${signal}_read`),
      phase: phaseColumn(bench),
      state: find("state"),
    };
    this.unit = shown(unit);
    this.fine = fine(unit);
    this.fields = new Map();
    const names = [
      [signal, "large"],
      ["reference", ""],
      ["measured", ""],
      ["deviation", ""],
      ["phase", ""],
      ["standstill rms", "large"],
      ["peak to peak", ""],
    ];
    const grid = make("dl", { className: "dials" });
    for (const [name, size] of names) {
      const value = make("dd", { className: size, textContent: "–" });
      value.dataset.name = name;
      this.fields.set(name, value);
      grid.append(make("div", { className: size }, make("dt", { textContent: words(name) }), value));
    }
    this.signal = signal;
    const figure = make("figure");
    this.note = make("p", { className: "empty" });
    place.replaceChildren(make("div", { className: "stack values" }, make("div", {}, grid, this.note), figure));
    this.plane = new Plane(figure, "Time from now / ms", `${words(signal)} − reference / ${this.fine.name}`);
  }

  draw() {
    const { store, columns, bench } = this;
    const now = performance.now();
    if (!store.count || now < this.#due) return;
    this.#due = now + UPDATE_INTERVAL_MS;
    const last = (column) => (column < 0 ? NaN : store.value(column, store.count - 1));
    const actual = last(columns.actual);
    this.#say(this.signal, actual, this.unit);
    this.#say("reference", last(columns.reference), this.unit);
    this.#say("measured", last(columns.read), this.unit);
    const phase = bench.phases[last(columns.phase)] ?? "–";
    this.fields.get("phase").textContent = `${phase}, ${bench.states[last(columns.state)] ?? ""}`;
    this.#deviation(actual - last(columns.reference));
  }

  table() {
    const { times = [], errors = [] } = this.drawn ?? {};
    const name = `${this.signal}_deviation_${this.bench.aim.unit}`;
    return { t_s: times.map((one) => one / 1e3), [name]: errors.map((one) => one / this.fine.factor) };
  }

  words() {
    return [[...this.fields].map(([name, { textContent }]) => [`${name} ${textContent}`])];
  }

  // Shows the deviation from the reference, and the standstill noise while the reference is constant.
  #deviation(present) {
    const { store, columns, bench } = this;
    const { name, factor } = this.fine;
    this.#say("deviation", present, this.fine);
    const first = store.find(store.newest - WINDOW_S * bench.rate);
    const times = [];
    const errors = [];
    const wanted = store.value(columns.reference, first);
    let stood = store.newest - store.tick(first) >= 0.9 * WINDOW_S * bench.rate;
    for (let row = first; row < store.count; row++) {
      const reference = store.value(columns.reference, row);
      if (reference !== wanted) stood = false;
      times.push((1e3 * (store.tick(row) - store.newest)) / bench.rate);
      errors.push((store.value(columns.actual, row) - reference) * factor);
    }
    this.drawn = { times, errors };
    this.plane.begin([times[0], times.at(-1), ...limits(errors)]);
    this.plane.line(times, errors, BLUE, 1);
    const mean = errors.reduce((sum, one) => sum + one, 0) / errors.length;
    const rms = Math.sqrt(errors.reduce((sum, one) => sum + (one - mean) ** 2, 0) / errors.length);
    this.standstill = stood ? rms : null;
    const [low, high] = [Math.min(...errors), Math.max(...errors)];
    this.#write("standstill rms", stood ? `${digits(rms)} ${name}` : "–");
    this.#write("peak to peak", stood ? `${digits(high - low)} ${name}` : "–");
    this.note.textContent = stood ? "" : `The noise at standstill is measured while the reference is constant for ${1e3 * WINDOW_S} ms.`;
  }

  #say(field, value, { name, factor }) {
    this.#write(field, Number.isFinite(value) ? `${digits(value * factor)} ${name}` : "–");
  }

  #write(field, text) {
    this.fields.get(field).textContent = text;
  }
}

// Formats a number with four digits, at most three of them decimals, so that its width stays constant.
function digits(value) {
  const whole = Math.max(1, Math.ceil(Math.log10(Math.abs(value) + 1e-9)));
  return value.toFixed(Math.max(0, Math.min(3, 4 - whole)));
}
