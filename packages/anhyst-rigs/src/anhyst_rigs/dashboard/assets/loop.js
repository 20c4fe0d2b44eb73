// The loop view: force against current with the measured loops, or position against voltage. A second
// plot shows the difference from the controller's demand, against the demand.

import { Plane, atLeast, limits } from "./canvas.js";
import { BLUE, GREEN, VERMILION, ink } from "./colours.js";
import { field, make, select } from "./dom.js";
import { words } from "./names.js";
import { columnOf, leastSpan } from "./signals.js";
import { fine, seconds, shown } from "./units.js";

const MAX_POINTS = 5000;
const UPDATE_INTERVAL_MS = 50;
const WINDOWS = [0.1, 0.2, 0.5, 1, 2, 5, 10];

export class LoopView {
  #due = 0;
  #version = 0; // version of the stored loops

  constructor(place, bench, store) {
    this.bench = bench;
    this.store = store;
    const find = (name) => columnOf(bench, name);
    const magnet = find("current") >= 0;
    this.current = find(magnet ? "current" : "voltage");
    this.force = find(!magnet ? "position" : find("force") >= 0 ? "force" : "expected"); // a bearing has no force sensor
    this.name = magnet ? "force" : "position";
    const { unit } = bench.signals[this.force];
    this.shown = shown(unit);
    this.fine = magnet ? this.shown : fine(unit);
    this.demand = find("demand");
    this.windows = select(
      WINDOWS.map((one) => [String(one), seconds(one)]),
      bench.choices.get("loop window", "0.5"),
    );
    this.windows.onchange = () => bench.choices.set("loop window", this.windows.value);
    this.note = make("output", { className: "reading" });
    const left = make("figure");
    const right = make("figure");
    const bar = make("div", { className: "bar" }, field("Of the last", this.windows), this.note);
    place.replaceChildren(bar, make("div", { className: "pair" }, left, right));
    this.gap = find("gap");
    this.legend = make("output", { className: "reading" });
    bar.append(this.legend);
    this.know(bench.loops);
    this.loop = new Plane(
      left,
      magnet ? "Current / A" : "Voltage / V",
      `${words(this.name)} / ${this.shown.name}`,
    );
    const off = `${words(this.name)} − demand / ${this.fine.name}`;
    this.error = new Plane(right, `Demand / ${this.shown.name}`, off);
  }

  // Stores the measured loops and those of the active model, which are drawn below the running loop.
  know(loops) {
    this.known = loops;
    this.#version++;
    this.legend.textContent = named(loops);
  }

  draw() {
    const { store, bench } = this;
    const now = performance.now();
    if (!store.count || now < this.#due) return;
    this.#due = now + UPDATE_INTERVAL_MS;
    const from = store.find(store.newest - Number(this.windows.value) * bench.rate);
    const every = Math.max(1, Math.ceil((store.count - from) / MAX_POINTS));
    const rows = [];
    for (let row = from; row < store.count; row += every) rows.push(row);
    const column = (n) => rows.map((row) => store.value(n, row));
    this.drawn = {
      ticks: rows.map((row) => store.tick(row)),
      currents: column(this.current),
      forces: column(this.force),
    };
    const gap = this.gap < 0 ? null : store.value(this.gap, store.count - 1);
    const forces = this.drawn.forces.map((one) => one * this.shown.factor);
    this.#drawLoop(this.drawn.currents, forces, gap);
    if (this.demand >= 0) this.#drawError(column(this.demand), this.drawn.forces);
  }

  table() {
    const { ticks = [], currents = [], forces = [] } = this.drawn ?? {};
    const head = (column) => this.bench.signals[column].head;
    return { tick: ticks, [head(this.current)]: currents, [head(this.force)]: forces };
  }

  words() {
    return [[[this.note.textContent], [this.legend.textContent]]];
  }

  // Draws the running loop above the stored loops; those of the nearest gap are highlighted.
  #drawLoop(currents, forces, gap) {
    const { known } = this;
    const away = known.map((one) => (gap === null ? 0 : Math.abs(one.gap - gap)));
    const least = Math.min(...away);
    const span = (column, factor) => leastSpan(this.bench, this.store, this.bench.signals[column].unit) * factor;
    const x = atLeast(limits(currents, ...known.map((one) => one.current)), span(this.current, 1));
    const y = atLeast(limits(forces, ...known.map((one) => one.force)), span(this.force, this.shown.factor));
    this.loop.begin([...x, ...y]);
    this.loop.backdrop(`${this.#version} ${away.indexOf(least)}`, () => {
      for (const one of ["measured", "model"]) {
        for (const [n, { kind, current, force }] of known.entries()) {
          if (kind !== one) continue;
          const near = away[n] <= least;
          const [colour, width] = kind === "model" ? [GREEN, 1] : [ink("--soft"), 3];
          this.loop.line(current, force, colour, width, near ? 0.9 : 0.2);
        }
      }
    });
    this.loop.line(currents, forces, BLUE, 2);
    this.loop.dot(currents.at(-1), forces.at(-1), VERMILION);
  }

  #drawError(wanted, forces) {
    const errors = forces.map((force, i) => (force - wanted[i]) * this.fine.factor);
    const demands = wanted.map((one) => one * this.shown.factor);
    this.error.begin([...limits(demands), ...limits(errors)]);
    this.error.line(demands, errors, BLUE, 1.5);
    this.error.dot(demands.at(-1), errors.at(-1), VERMILION);
    const rms = Math.sqrt(errors.reduce((sum, one) => sum + one * one, 0) / errors.length);
    this.note.textContent = `${this.name} − demand: rms ${Number(rms.toPrecision(3))} ${this.fine.name}`;
  }
}

function named(loops) {
  if (!loops.length) return "";
  const gaps = [...new Set(loops.map((one) => one.gap))].filter((gap) => gap !== null);
  const at = gaps.length ? ` at ${gaps.map((gap) => Number((1e6 * gap).toPrecision(4))).join(", ")} µm` : "";
  const model = loops.some((one) => one.kind === "model") ? ", the model's green" : "";
  return `Grey: measured${at}${model}; nearest gap bold`;
}
