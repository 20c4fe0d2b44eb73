// The scope view: selected signals over time, one strip per unit, with hold, zoom, trigger and cursors.

import { COLOURS, ink } from "./colours.js";
import { Cursors } from "./cursors.js";
import { field, make, select } from "./dom.js";
import { columnOf } from "./signals.js";
import { Strip } from "./strip.js";
import { Trigger } from "./trigger.js";
import { seconds, show, shown } from "./units.js";

const READ_MS = 100; // time between two updates of the displayed values
const MIN_WINDOW_TICKS = 20; // shortest window, ticks
const WHEEL_FACTOR = 0.002; // change of the logarithm of the window per pixel of the wheel
const WINDOWS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20];

export class Scope {
  held = null; // last tick of a held picture; null if the newest tick is shown
  view = { from: 0, to: 0 }; // range of visible ticks
  #before = []; // cursors before the last click, restored if it becomes a double click
  #pointer = null; // time at the pointer, s
  #readAt = 0;
  #size = { width: 0, height: 0 };
  #trigger = null;
  #unzoomed = null; // window and held tick before the picture was zoomed

  constructor(place, bench, store) {
    this.place = place;
    this.bench = bench;
    this.store = store;
    this.signals = bench.signals.map((signal, n) => ({
      ...signal,
      column: n,
      colour: COLOURS[n % COLOURS.length],
    }));
    const tracked = columnOf(bench, "error") >= 0; // show the error, which is invisible next to the long travel
    const followed = tracked ? ["error"] : [bench.aim.signal, bench.aim.reference];
    const usual = [...followed, "force", columnOf(bench, "current") < 0 ? "voltage" : "current"];
    this.chosen = new Set(bench.choices.get("signals", usual));
    this.window = bench.choices.get("window", 0.5);
    this.cursors = new Cursors(store, bench.rate);
    this.#controls();
    this.#build();
  }

  feed(frame) {
    this.#trigger?.feed(frame);
  }

  // --- visible range ------------------------------------------------------------------------

  draw() {
    const to = this.#end();
    const from = to - this.window * this.bench.rate;
    this.view = { from, to };
    this.#resize();
    for (const strip of this.strips) {
      const columns = strip.signals.map((signal) => signal.column);
      const pixels = Math.max(50, Math.round(strip.plot.bbox.width / devicePixelRatio));
      strip.show(this.store.envelope(columns, from, to, pixels), from, to);
    }
    if (performance.now() >= this.#readAt) {
      this.#readAt = performance.now() + READ_MS;
      this.#read();
    }
  }

  // Returns the last visible tick: that of the held picture, that of the trigger, or the newest.
  #end() {
    if (this.held !== null) return this.held;
    const trigger = this.#trigger;
    if (!trigger) return this.store.newest;
    const after = (1 - trigger.settings.pre) * this.window * this.bench.rate;
    if (trigger.hit !== null && this.store.newest >= trigger.hit + after) {
      this.shot = { hit: trigger.hit, end: Math.round(trigger.hit + after) };
      if (trigger.settings.mode === "single") this.hold(this.shot.end);
      else trigger.rearm();
    }
    if (this.shot && (trigger.settings.mode !== "auto" || this.#fresh())) return this.shot.end;
    return trigger.settings.mode === "auto"
      ? this.store.newest
      : (this.shot?.end ?? this.store.newest);
  }

  #fresh() {
    return this.store.newest - this.shot.end < (this.window + 0.5) * this.bench.rate;
  }

  hold(tick = this.store.newest) {
    this.held = tick;
    this.holdButton.textContent = "follow";
    this.place.classList.add("held");
  }

  follow() {
    this.held = null;
    this.shot = null;
    this.#unzoomed = null;
    this.#trigger?.rearm();
    this.window = this.bench.choices.get("window", 0.5);
    this.holdButton.textContent = "hold";
    this.place.classList.remove("held");
  }

  toggle() {
    if (this.held === null) this.hold();
    else this.follow();
  }

  zoom(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const from = plot.posToVal(left, "x");
    const to = plot.posToVal(left + width, "x");
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.#zoomTo(to - from, to);
  }

  // Zooms around a time, s, by a rotation of the wheel, pixels.
  zoomAt(time, turn) {
    const [shortest, longest] = [MIN_WINDOW_TICKS / this.bench.rate, WINDOWS.at(-1)];
    const wanted = this.window * Math.exp(WHEEL_FACTOR * turn);
    const window = Math.max(shortest, Math.min(longest, wanted));
    const after = this.view.to / this.bench.rate - time;
    this.#zoomTo(window, time + (after * window) / this.window);
  }

  #zoomTo(window, to) {
    this.#unzoomed ??= { window: this.window, held: this.held };
    this.window = window;
    this.hold(Math.min(this.store.newest, Math.round(to * this.bench.rate)));
  }

  // Restores the picture before the zoom; without a zoom, follows the newest tick.
  back() {
    this.cursors.ticks = this.#before;
    const { window, held } = this.#unzoomed ?? { held: null };
    if (held === null) return this.follow();
    this.#unzoomed = null;
    this.window = window;
    return this.hold(held);
  }

  widen(way) {
    const at = WINDOWS.findIndex((one) => one >= this.window * 0.999);
    this.setWindow(WINDOWS[Math.max(0, Math.min(WINDOWS.length - 1, (at < 0 ? 99 : at) + way))]);
  }

  setWindow(value) {
    this.window = value;
    this.widths.value = String(value);
    this.bench.choices.set("window", value);
  }

  // --- cursors ------------------------------------------------------------------------------

  point(plot) {
    this.#pointer = plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : null;
  }

  // Sets a cursor at a time, s, and holds the picture.
  put(time) {
    this.#before = this.cursors.ticks;
    if (this.held === null) this.hold(Math.round(this.view.to));
    this.cursors.put(time);
  }

  #chosen() {
    return this.signals.filter((signal) => this.chosen.has(signal.name));
  }

  // Shows the values at the pointer, or the newest ones, and the statistics between the cursors.
  #read() {
    const { store, bench } = this;
    if (!store.count) return;
    const newest = store.count - 1;
    const row = this.#pointer === null ? newest : Math.min(store.find(this.#pointer * bench.rate), newest);
    for (const { name, unit, column } of this.#chosen())
      this.readings.get(name).textContent = show(store.value(column, row), unit);
    this.timeReading.textContent = `t ${(store.tick(row) / bench.rate).toFixed(5)} s`;
    this.cursors.show(this.#chosen());
  }

  // Returns the selected signals at all visible ticks, as a table in SI units.
  table() {
    const { store } = this;
    const [first, end] = [store.find(this.view.from), store.find(this.view.to + 1)];
    const chosen = this.#chosen();
    const came = (row) => chosen.some(({ column }) => !Number.isNaN(store.value(column, row)));
    const rows = Array.from({ length: end - first }, (_, n) => first + n).filter(came);
    const ticks = rows.map((row) => store.tick(row));
    const value = (column) => (row) => Number(store.value(column, row).toPrecision(9));
    return {
      tick: ticks,
      t_s: ticks.map((tick) => tick / this.bench.rate),
      ...Object.fromEntries(chosen.map(({ head, column }) => [head, rows.map(value(column))])),
    };
  }

  // Returns the text above the picture: signals in their colours, and the statistics of the cursors.
  words() {
    const { cursors } = this;
    const figures = cursors.lines();
    return [this.#chosen().map(({ name, colour }) => [name, colour]), ...figures.map((one) => [[one]])];
  }

  // Draws the lines of the cursors and the trigger, and bands where ticks are missing.
  mark(plot) {
    const { ctx, bbox } = plot;
    const { rate } = this.bench;
    const line = (time, colour) => {
      const x = plot.valToPos(time, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) return;
      ctx.fillStyle = colour;
      ctx.fillRect(Math.round(x), bbox.top, devicePixelRatio, bbox.height);
    };
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = "rgba(176, 0, 32, 0.35)";
    for (const [first, last] of this.store.missing) {
      const x = plot.valToPos(first / rate, "x", true);
      ctx.fillRect(
        x,
        bbox.top,
        Math.max(2, plot.valToPos((last + 1) / rate, "x", true) - x),
        bbox.height,
      );
    }
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    for (const [n, tick] of this.cursors.ticks.entries()) {
      line(tick / rate, ink("--ink"));
      ctx.fillText("AB"[n], plot.valToPos(tick / rate, "x", true) + 4, bbox.top + 12 * devicePixelRatio);
    }
    if (this.shot && this.#trigger) line(this.shot.hit / rate, ink("--bad"));
    ctx.restore();
  }

  // --- controls -----------------------------------------------------------------------------

  #controls() {
    this.holdButton = make("button", {
      textContent: "hold",
      title: "Space",
      onclick: () => this.toggle(),
    });
    this.widths = select(
      WINDOWS.map((one) => [String(one), seconds(one)]),
      String(this.window),
    );
    this.widths.onchange = () => this.setWindow(Number(this.widths.value));
    this.timeReading = make("output", { className: "reading" });
    this.readings = new Map();
    const legend = make("div", { className: "legend" });
    for (const signal of this.signals) legend.append(this.#choice(signal));
    const bar = make("div", { className: "bar" }, this.holdButton, field("window", this.widths));
    bar.append(...this.#triggerControls(), this.timeReading);
    this.stripsPlace = make("div", { className: "strips" });
    new ResizeObserver(([{ contentRect }]) => {
      this.#size = { width: Math.floor(contentRect.width), height: Math.floor(contentRect.height) };
    }).observe(this.stripsPlace);
    this.stripsPlace.title = "click: cursors A and B; drag or wheel: zoom; double click: back";
    // The statistics are below the strips, so that the strips do not move when a cursor is set.
    this.place.replaceChildren(bar, legend, this.stripsPlace, this.cursors.element);
  }

  #choice(signal) {
    const box = make("input", { type: "checkbox", checked: this.chosen.has(signal.name) });
    box.onchange = () => {
      if (box.checked) this.chosen.add(signal.name);
      else this.chosen.delete(signal.name);
      this.bench.choices.set("signals", [...this.chosen]);
      this.#build();
    };
    const reading = make("output", { className: "reading" });
    this.readings.set(signal.name, reading);
    const swatch = make("i", { className: "swatch" });
    swatch.style.background = signal.colour;
    return make("label", { title: signal.doc }, box, swatch, signal.name, reading);
  }

  #triggerControls() {
    const mode = select(
      [
        ["off", "off"],
        ["auto", "auto"],
        ["normal", "normal"],
        ["single", "single"],
      ],
      "off",
    );
    const signal = select(
      this.signals.map((one) => [one.name, one.name]),
      "force",
    );
    const edge = select(
      [
        ["rising", "↗"],
        ["falling", "↘"],
      ],
      "rising",
    );
    const level = make("input", { type: "number", step: "any", value: "0", className: "number" });
    const pre = make("input", {
      type: "number",
      min: 0,
      max: 100,
      value: "20",
      className: "number",
    });
    const unit = make("span", { className: "unit" });
    const arm = () => {
      const chosen = this.signals.find((one) => one.name === signal.value);
      const { name, factor } = shown(chosen.unit);
      unit.textContent = name;
      this.follow();
      this.#trigger =
        mode.value === "off"
          ? null
          : new Trigger({
              column: chosen.column,
              level: Number(level.value) / factor,
              rising: edge.value === "rising",
              pre: Math.min(1, Math.max(0, Number(pre.value) / 100)),
              mode: mode.value,
            });
    };
    for (const one of [mode, signal, edge, level, pre]) one.onchange = arm;
    mode.id = "trigger-mode";
    signal.id = "trigger-signal";
    level.id = "trigger-level";
    edge.id = "trigger-edge";
    pre.id = "trigger-pre";
    arm();
    return [
      field("trigger", mode),
      signal,
      edge,
      field("at", level, unit),
      field("before", pre, "%"),
    ];
  }

  #build() {
    this.stripsPlace.replaceChildren();
    const chosen = this.#chosen();
    const units = [...new Set(chosen.map((signal) => signal.unit))];
    this.strips = units.map((unit) => {
      const signals = chosen.filter((signal) => signal.unit === unit);
      return new Strip(this.stripsPlace, unit, signals, this, unit === units.at(-1));
    });
  }

  #resize() {
    const { width, height } = this.#size;
    const heights = Strip.heights(this.strips.length, height);
    for (const [n, strip] of this.strips.entries()) strip.resize(width, heights[n]);
  }

  restyle() {
    for (const strip of this.strips) strip.plot.redraw();
  }
}
