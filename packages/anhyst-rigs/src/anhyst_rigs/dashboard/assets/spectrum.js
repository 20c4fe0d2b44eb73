// The spectrum view: amplitude spectral density of a signal, and its value at the cursor.

import { Plane } from "./canvas.js";
import { BLUE, VERMILION, ink } from "./colours.js";
import { field, make, select } from "./dom.js";
import { WINDOWS, density } from "./fft.js";
import { NO_SIGNAL, signalChoice, signalOf } from "./signals.js";
import { fine } from "./units.js";

const LENGTHS = [1024, 4096, 16384, 65536];
const MAX_AVERAGED_SEGMENTS = 4; // largest number of segment lengths that are averaged
const UPDATE_INTERVAL_MS = 250;

export class SpectrumView {
  #due = 0;
  #cursor = null; // frequency of the cursor, Hz

  constructor(place, bench, store) {
    this.bench = bench;
    this.store = store;
    const choose = (id, names, chosen) => {
      const element = select(
        names,
        String(bench.choices.get(id, chosen)),
      );
      element.id = id;
      element.onchange = () => {
        bench.choices.set(id, element.value);
        this.#due = 0;
      };
      return element;
    };
    const plain = (values) => values.map((value) => [String(value), String(value)]);
    const chosen = bench.choices.get("spectrum-signal", bench.aim.signal);
    const properties = { id: "spectrum-signal", onchange: () => this.#chooseSignal() };
    this.signal = signalChoice(bench, signalOf(bench, chosen) ? chosen : bench.aim.signal, "signal of the spectrum", properties);
    this.length = choose("spectrum-length", plain(LENGTHS), 16384);
    this.shape = choose("spectrum-window", plain(Object.keys(WINDOWS)), "Hann");
    this.note = make("output", { className: "reading", id: "spectrum-note" });
    this.reading = make("output", { className: "reading", id: "spectrum-reading" });
    const figure = make("figure");
    place.replaceChildren(
      make(
        "div",
        { className: "bar" },
        field("Signal", this.signal),
        field("Ticks", this.length),
        field("Window", this.shape),
        this.note,
        this.reading,
      ),
      make("div", { className: "whole" }, figure),
    );
    this.plane = new Plane(figure, "Frequency / Hz", "", true);
    this.plane.onCursor((x) => {
      this.#cursor = x === null ? null : 10 ** x;
      this.#due = 0;
    });
  }

  #chooseSignal() {
    this.bench.choices.set("spectrum-signal", this.signal.value);
    this.#due = 0;
  }

  draw() {
    const now = performance.now();
    if (now < this.#due) return;
    this.#due = now + UPDATE_INTERVAL_MS;
    const length = Number(this.length.value);
    const signal = signalOf(this.bench, this.signal.value);
    const samples = this.#samples(signal, length);
    if (!samples) return;
    const { name, factor } = fine(signal.unit);
    const rate = this.bench.rate / this.bench.every;
    const found = density(samples, rate, length, WINDOWS[this.shape.value]);
    this.found = { ...found, head: signal.head, ticks: samples.length };
    const scaled = found.densities.map((one) => one * factor);
    const top = Math.max(...scaled) || 1;
    const logs = (values) => values.map((one) => Math.log10(Math.max(one, 1e-9 * top)));
    const [xs, ys] = [logs(found.frequencies), logs(scaled)];
    const lowest = Math.max(Math.min(...ys), Math.log10(top) - 8);
    this.plane.labels[1] = `${name || "1"}/√Hz`;
    this.plane.begin([xs[0], xs.at(-1), lowest - 0.2, Math.log10(top) + 0.3]);
    this.plane.line(xs, ys, BLUE, 1.2);
    this.note.textContent =
      `${Number((rate / length).toPrecision(3))} Hz apart, ` +
      `rms ${Number((factor * rms(found, rate / length)).toPrecision(4))} ${name}`;
    this.#read(found, xs, ys, scaled, name);
  }

  table() {
    const { head = "none", frequencies = [], densities = [] } = this.found ?? {};
    return { frequency_Hz: frequencies, [`${head}_per_sqrt_Hz`]: densities };
  }

  words() {
    return [[[this.signal.value], [this.note.textContent]]];
  }

  #read({ frequencies }, xs, ys, scaled, name) {
    this.reading.textContent = "";
    if (this.#cursor === null) return;
    const step = frequencies[0];
    const at = Math.min(frequencies.length, Math.max(1, Math.round(this.#cursor / step))) - 1;
    this.plane.line([xs[at], xs[at]], [-99, 99], ink("--ink"), 1);
    this.plane.dot(xs[at], ys[at], VERMILION);
    const value = Number(scaled[at].toPrecision(4));
    this.reading.textContent = `${Number(frequencies[at].toPrecision(6))} Hz: ${value} ${name || "1"}/√Hz`;
  }

  // Returns the last samples; null if there are fewer than one length, if ticks are missing or if the signal is.
  #samples(signal, length) {
    const { store } = this;
    if (!signal) {
      this.note.textContent = NO_SIGNAL;
      return null;
    }
    const wanted = Math.min(MAX_AVERAGED_SEGMENTS * length, store.count);
    const first = store.count - wanted;
    const whole = wanted >= length && store.newest - store.tick(first) === wanted - 1;
    if (!whole) {
      this.note.textContent = `The spectrum needs ${length} ticks without a gap between them; wait, or choose fewer ticks.`;
      return null;
    }
    return Float64Array.from({ length: wanted }, (_, i) => store.value(signal.column, first + i));
  }
}

function rms({ densities }, step) {
  return Math.sqrt(densities.reduce((sum, one) => sum + one * one * step, 0));
}
