// Wrench, errors, gaps and forces of a body with several coordinates, as numbers and bars.

import { make } from "./dom.js";
import { columnOf } from "./signals.js";
import { fine, shown } from "./units.js";

const UPDATE_INTERVAL_MS = 100; // time between two updates
const ERROR_WINDOW_S = 1; // time window of the largest error
const MAX_FINE_VALUE = 1e4; // value in the fine unit above which the usual unit is shown

// Returns the name of a magnet's signal; that of the first magnet has no number.
export const numbered = (name, n) => (n ? `${name}_${n + 1}` : name);

export class Figures {
  #due = 0;

  constructor(bench, store) {
    this.bench = bench;
    this.store = store;
    const { free, magnets, force, stops } = bench.body;
    this.axes = free.map((axis) => [axis, ["demand", "wrench", "error"].map((name) => this.#cell(`${name}_${axis}`))]);
    this.magnets = magnets.map((one, n) => [
      one.name,
      [
        this.#cell(numbered("gap", n), (value) => (2 * (value - one.gap)) / (stops[1] - stops[0])),
        this.#cell(numbered("pull", n), (value) => value / force),
        this.#cell(numbered("current", n), () => NaN),
      ],
    ]);
    this.place = make(
      "div",
      { className: "scroll", tabIndex: 0, role: "region", ariaLabel: "forces and errors" },
      table("axes", ["", "demanded, now", "applied, now", `error, largest of ${ERROR_WINDOW_S} s`], this.axes),
      table("magnets", ["", "gap, from stop to stop", "force", "current"], this.magnets),
    );
  }

  // Returns a cell with a number and a bar. `part` converts the value to the length of the bar; without
  // it, the length is relative to the largest value with the same unit.
  #cell(name, part = null) {
    const column = columnOf(this.bench, name);
    const { unit, head } = this.bench.signals[column];
    const text = make("span");
    const bar = make("i");
    const element = make("td", {}, text, make("span", { className: "gauge" }, bar));
    element.dataset.signal = name;
    return { column, unit, head, part, text, bar, element, of: name.startsWith("error") ? fine(unit) : shown(unit) };
  }

  draw() {
    const { store, bench } = this;
    if (performance.now() < this.#due) return;
    this.#due = performance.now() + UPDATE_INTERVAL_MS;
    const first = store.find(store.newest - ERROR_WINDOW_S * bench.rate);
    const largest = {};
    for (const cell of this.axes.flatMap(([, cells]) => cells)) {
      cell.peak = store.largest(cell.column, first);
      const kind = `${cell.unit} ${cell.of.name}`;
      largest[kind] = Math.max(largest[kind] ?? 0, cell.peak);
    }
    for (const cell of [...this.axes, ...this.magnets].flatMap(([, cells]) => cells)) {
      const now = store.value(cell.column, store.count - 1);
      const part = cell.part ? cell.part(now) : now / largest[`${cell.unit} ${cell.of.name}`];
      const told = cell.head.startsWith("error") ? cell.peak : now;
      const { name, factor } = Math.abs(told * cell.of.factor) < MAX_FINE_VALUE ? cell.of : shown(cell.unit);
      cell.text.textContent = `${digits(told * factor)} ${name}`;
      cell.bar.style.transform = `scaleX(${Math.max(-1, Math.min(1, part || 0))})`;
    }
  }

  // Returns the values of every tick of the last second.
  table() {
    const { store, bench } = this;
    const first = store.find(store.newest - ERROR_WINDOW_S * bench.rate);
    const rows = Array.from({ length: store.count - first }, (_, n) => first + n);
    const cells = [...this.axes, ...this.magnets].flatMap(([, each]) => each);
    const of = ({ head, column }) => [head, rows.map((row) => store.value(column, row))];
    return { t_s: rows.map((row) => store.tick(row) / bench.rate), ...Object.fromEntries(cells.map(of)) };
  }

  words() {
    const row = ([name, cells]) => [[name], ...cells.map(({ text }) => [text.textContent])];
    return [[["demanded, applied, largest error of the last second; gap, force, current"]], ...[...this.axes, ...this.magnets].map(row)];
  }
}

function table(id, heads, rows) {
  const head = heads.map((text) => make("th", { textContent: text, scope: "col" }));
  const body = rows.map(([name, cells]) =>
    make("tr", {}, make("th", { textContent: name, scope: "row" }), ...cells.map(({ element }) => element)),
  );
  return make("table", { id, className: "gauges" }, make("thead", {}, make("tr", {}, ...head)), make("tbody", {}, ...body));
}

// Formats a number with four digits, at most three of them decimals; a rounded zero has no sign.
function digits(value) {
  const whole = Math.max(1, Math.ceil(Math.log10(Math.abs(value) + 1e-9)));
  const places = Math.max(0, Math.min(3, 4 - whole));
  return Number(value.toFixed(places)).toFixed(places);
}
