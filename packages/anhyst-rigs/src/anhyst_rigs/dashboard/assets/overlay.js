// A recording of this program, read from a file, that is drawn behind the running signals.

import { readCsv, readMdf } from "./recordings.js";
import { Store } from "./store.js";

export class Overlay {
  shift = null; // ticks from the recording's time to that of the bench; null before it has a place
  #nudge = 0; // shift that the user adds, ticks
  #aligned = 0;

  // Reads a file; throws an error with the reason if it is not a recording of this bench.
  static async read(file, bench) {
    const table = /\.mf4$/i.test(file.name) ? readMdf(await file.arrayBuffer()) : readCsv(await file.text());
    if (!table.ticks.length) throw new Error("contains no rows");
    const columns = new Map();
    for (const signal of bench.signals) {
      const values = table.columns.get(signal.head) ?? table.columns.get(signal.name);
      if (values) columns.set(signal.name, values);
    }
    if (!columns.size) throw new Error("contains no signal of this bench");
    return new Overlay(file.name, table.ticks, columns);
  }

  constructor(name, ticks, columns) {
    this.name = name;
    this.ticks = ticks;
    this.columns = columns;
    this.order = new Map([...columns.keys()].map((signal, n) => [signal, n]));
    this.store = new Store(columns.size, 1, ticks.length);
    this.store.push({ first: ticks[0], last: ticks.at(-1), ticks, data: [...columns.values()] });
  }

  // Aligns the first crossing of a trigger's level with a tick of the bench.
  align({ name, level, rising }, tick) {
    const values = this.columns.get(name);
    const sign = rising ? 1 : -1;
    const crossed = values?.findIndex((value, n) => n && sign * (value - level) >= 0 && sign * (values[n - 1] - level) < 0);
    if (crossed > 0) this.#move(tick - this.ticks[crossed]);
    else this.place(tick);
  }

  // Places the start of the recording at a tick, unless it already has a place.
  place(tick) {
    if (this.shift === null) this.#move(tick - this.ticks[0]);
  }

  #move(aligned) {
    this.#aligned = aligned;
    this.shift = aligned + this.#nudge;
  }

  nudge(ticks) {
    this.#nudge = ticks;
    this.#move(this.#aligned);
  }

  // Returns the columns to draw between two ticks of the bench, for the signals that the recording contains.
  envelope(signals, from, to, pixels) {
    const known = signals.filter((signal) => this.order.has(signal.name));
    const columns = known.map((signal) => this.order.get(signal.name));
    const trace = this.store.envelope(columns, from - this.shift, to - this.shift, pixels);
    return { ...trace, signals: known, shift: this.shift };
  }
}
