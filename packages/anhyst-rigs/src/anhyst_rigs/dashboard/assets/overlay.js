// A recording of this program, read from a file, that is drawn behind the running signals.

import { readCsv, readMdf } from "./recordings.js";
import { Store } from "./store.js";

const MAX_RATE_ERROR = 0.01; // largest relative difference between the tick rates of a recording and the rig

export class Overlay {
  shift = 0; // ticks from the recording's time to that of the bench
  crosses = false; // whether its crossing of the trigger level is aligned with the shown one
  #nudge = 0; // shift that the user adds, ticks
  #crossing = {}; // settings of the last trigger, and the tick at which the recording crosses its level

  // Reads a file; throws an error with the reason if it is not a recording of this bench.
  static async read(file, bench) {
    const table = /\.mf4$/i.test(file.name) ? readMdf(await file.arrayBuffer()) : readCsv(await file.text());
    if (!table.ticks.length) throw new Error("contains no rows");
    const columns = new Map();
    for (const signal of bench.signals) {
      const hasUnit = (table.units?.get(signal.name) ?? signal.unit) === signal.unit;
      const values = table.columns.get(signal.head) ?? (hasUnit && table.columns.get(signal.name));
      if (values) columns.set(signal.name, values);
    }
    if (!columns.size) throw new Error("contains no signal of this bench");
    const rate = rateOf(table);
    if (Math.abs(rate / bench.rate - 1) > MAX_RATE_ERROR)
      throw new Error(`was recorded at ${Number(rate.toPrecision(3))} ticks per second, but this rig runs at ${bench.rate}`);
    const measured = bench.signals.filter(({ expression }) => !expression);
    const common = measured.filter(({ name }) => columns.has(name)).length;
    const missing = common < measured.length ? `, only ${common} of ${measured.length} signals` : "";
    return new Overlay(file.name + missing, table.ticks, columns);
  }

  constructor(name, ticks, columns) {
    this.name = name; // of the file, and how many signals it lacks
    this.ticks = ticks;
    this.columns = columns;
    this.order = new Map([...columns.keys()].map((signal, n) => [signal, n]));
    this.store = new Store(columns.size, 1, ticks.length);
    this.store.push({ first: ticks[0], last: ticks.at(-1), ticks, data: [...columns.values()] });
  }

  // Duration, ticks.
  get span() {
    return this.ticks.at(-1) + 1 - this.ticks[0];
  }

  // Aligns the first crossing of a trigger's level with the tick `hit` of the bench; without a trigger or without a
  // crossing, the last row with the tick `end`.
  align(trigger, hit, end) {
    if (trigger && trigger !== this.#crossing.trigger) this.#crossing = { trigger, tick: this.#find(trigger) };
    this.crosses = Boolean(trigger) && this.#crossing.tick !== undefined;
    this.end = end;
    this.shift = this.#nudge + (this.crosses ? hit - this.#crossing.tick : end - this.ticks.at(-1));
  }

  // Returns the tick of the first crossing of a trigger's level; undefined if there is none.
  #find({ name, level, rising }) {
    const values = this.columns.get(name);
    const sign = rising ? 1 : -1;
    const row = values?.findIndex((value, n) => n && sign * (value - level) >= 0 && sign * (values[n - 1] - level) < 0);
    return this.ticks[row];
  }

  nudge(ticks) {
    this.#nudge = ticks;
  }

  // Whether no row is between two ticks of the bench.
  isOutside({ from, to }) {
    return this.ticks[0] + this.shift > to || this.ticks.at(-1) + this.shift < from;
  }

  // Returns the columns to draw between two ticks of the bench, for the signals that the recording contains.
  envelope(signals, from, to, pixels) {
    const known = signals.filter((signal) => this.order.has(signal.name));
    const columns = known.map((signal) => this.order.get(signal.name));
    const none = { ticks: [], columns: columns.map(() => []) };
    const trace = this.isOutside({ from, to }) ? none : this.store.envelope(columns, from - this.shift, to - this.shift, pixels);
    return { ...trace, signals: known, shift: this.shift };
  }
}

// Returns the number of ticks per second of a table; NaN if it has one row.
function rateOf({ ticks, times }) {
  return (ticks.at(-1) - ticks[0]) / (times.at(-1) - times[0]);
}
