// The time of all time plots: window, hold, zoom, trigger, cursors and overlaid recordings; and the scope view.

import { ink } from "./colours.js";
import { Cursors } from "./cursors.js";
import { field, make, select } from "./dom.js";
import { overlayMenu } from "./library.js";
import { columnOf } from "./signals.js";
import { TimePlot } from "./timeplot.js";
import { Trigger } from "./trigger.js";
import { TriggerControls } from "./triggercontrols.js";
import { seconds } from "./units.js";

const READ_MS = 100; // time between two updates of the displayed values
const MIN_WINDOW_TICKS = 20; // shortest window, ticks
const WHEEL_FACTOR = 0.002; // change of the logarithm of the window per pixel of the wheel
const WINDOWS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20];

export class Scope {
  held = null; // last tick of a held picture; null if the newest tick is shown
  view = { from: 0, to: 0, zero: 0 }; // range of visible ticks, and the tick whose time is zero on the axes
  overlays = []; // recordings that are drawn behind the running signals
  #before = []; // cursors before the last click, restored if it becomes a double click
  #kept = null; // copy of the rows of a held picture
  #pointer = null; // time at the pointer, s
  #readAt = 0;
  #trigger = null;
  #unzoomed = null; // window and held tick before the picture was zoomed

  constructor({ view, bar, figures }, bench, store, notify) {
    this.bar = bar;
    this.bench = bench;
    this.live = store;
    this.notify = notify;
    this.window = bench.choices.get("window", 0.5);
    this.cursors = new Cursors(store, bench.rate);
    this.plot = new TimePlot(this, bench.choices.get("signals", usual(bench)), (names) =>
      bench.choices.set("signals", names),
    );
    this.plots = new Set([this.plot]); // the plots of the open view
    this.#controls();
    view.replaceChildren(this.plot.element);
    figures.replaceChildren(this.cursors.element);
  }

  feed(frame) {
    const trigger = this.#trigger;
    trigger?.feed(frame, columnOf(this.bench, trigger.settings.name));
  }

  // The rows of the picture: those of the running bench, or those that were stored when the picture was held.
  get store() {
    return this.#kept ?? this.live;
  }

  // --- visible range ------------------------------------------------------------------------

  draw() {
    this.drawPlots(new Set([this.plot]));
  }

  // Draws the plots of the open view.
  drawPlots(plots) {
    this.plots = plots;
    const to = this.#end();
    const from = to - this.window * this.bench.rate;
    this.view = { from, to, zero: this.#zero(to) };
    this.#align();
    const { cursors, store } = this;
    const parts = [...Object.values(this.view), this.zeroName, store.newest, cursors.ticks, this.overlays.map((one) => [one.name, one.shift])];
    const state = parts.join(" ");
    for (const plot of plots) plot.draw(state);
    if (performance.now() >= this.#readAt) {
      this.#readAt = performance.now() + READ_MS;
      this.#read();
    }
  }

  // Returns the tick whose time is zero on the axes.
  #zero(to) {
    if (this.shot && this.#trigger) return this.shot.hit;
    return this.held === null ? to : this.heldZero;
  }

  // Name of the moment whose time is zero on the axes.
  get zeroName() {
    if (this.shot && this.#trigger) return "trigger";
    return this.held === null ? "now" : "hold";
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
    if (this.held === null) {
      this.heldZero = tick;
      this.#kept = this.cursors.store = this.live.copy();
    }
    this.held = tick;
    this.holdButton.textContent = "Follow";
    document.body.classList.add("held");
  }

  follow() {
    this.held = this.#kept = this.shot = null;
    this.cursors.store = this.live;
    this.#unzoomed = null;
    this.#trigger?.rearm();
    this.window = this.bench.choices.get("window", 0.5);
    this.holdButton.textContent = "Hold";
    document.body.classList.remove("held");
  }

  toggle() {
    if (this.held === null) this.hold();
    else this.follow();
  }

  // Zooms to the range between two times, s.
  zoom(from, to) {
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
    if (this.held === null) this.hold(Math.round(this.view.to));
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

  // --- cursors and overlays -----------------------------------------------------------------

  // Stores the time at the pointer, s; null if it is not over a plot.
  point(time) {
    this.#pointer = time;
  }

  // Sets a cursor at a time, s, and holds the picture.
  put(time) {
    this.#before = this.cursors.ticks;
    if (this.held === null) this.hold(Math.round(this.view.to));
    this.cursors.put(time);
  }

  // Sets a cursor with Enter, and moves it with the arrow keys by 1 % of the window, with Shift by one tick.
  key(event) {
    const { rate, every } = this.bench;
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "Enter") this.put((this.view.from + this.view.to) / (2 * rate));
    else if (way) this.cursors.move(way * (event.shiftKey ? every : Math.max(every, Math.round(0.01 * this.window * rate))));
  }

  // Returns the signals of the open plots.
  #shown() {
    const names = new Set([...this.plots].flatMap((plot) => [...plot.names]));
    return this.bench.signals.filter((signal) => names.has(signal.name));
  }

  // Shows the values at the pointer, at the cursor that was set last, or at the end of the picture; and the statistics
  // between the cursors.
  #read() {
    const { store, bench, view, cursors } = this;
    if (!store.count) return;
    const end = this.held !== null && cursors.ticks.includes(cursors.last) ? cursors.last : view.to;
    const tick = this.#pointer === null ? end : this.#pointer * bench.rate;
    const row = Math.min(store.find(tick), store.count - 1);
    for (const plot of this.plots) plot.read(row);
    cursors.show(this.#shown(), view.zero);
    this.triggers.wait(this.#trigger && this.held === null && !(this.shot && this.#fresh()));
    for (const entry of this.overlayList.children) entry.update();
  }

  // Updates the menu of the recordings in the folder of the bench.
  listRecordings() {
    this.menu.list();
  }

  // Overlays a recording on all time plots.
  async overlay(file) {
    try {
      const { Overlay } = await import("./overlay.js");
      const overlay = await Overlay.read(file, this.bench);
      this.overlays = [...this.overlays, overlay];
      this.#align();
      if (this.held === null && !overlay.crosses) this.#fit(overlay);
      this.overlayList.append(this.#entry(overlay));
    } catch (wrong) {
      this.notify(`${file.name}: ${wrong.message}`);
    }
  }

  // Extends the window to the span of a recording, as far as possible.
  #fit({ span }) {
    const needed = WINDOWS.find((one) => one * this.bench.rate >= span) ?? WINDOWS.at(-1);
    if (needed > this.window) this.setWindow(needed);
  }

  // Moves each recording so that its crossing of the trigger level is at the shown one; without such a crossing, its
  // last row is at the newest shown time.
  #align() {
    const { shot, view } = this;
    const settings = shot && this.#trigger?.settings;
    for (const overlay of this.overlays) overlay.align(settings, view.zero, settings ? shot.end : view.zero);
  }

  // Returns the entry of a recording: file, span, place, shift, and whether it is visible.
  #entry(overlay) {
    const text = make("span");
    const shift = make("input", { type: "number", step: "any", value: 0, className: "number" });
    shift.oninput = () => overlay.nudge((Number(shift.value) / 1e3) * this.bench.rate);
    const remove = make("button", { className: "small", textContent: "×" });
    remove.setAttribute("aria-label", `remove ${overlay.name}`);
    const entry = make("span", { className: "key" }, text, field("shift", shift, "ms"), remove);
    remove.onclick = () => {
      this.overlays = this.overlays.filter((one) => one !== overlay);
      entry.remove();
    };
    entry.update = () => {
      const words = this.#describe(overlay);
      if (text.textContent !== words) text.textContent = words;
    };
    entry.update();
    return entry;
  }

  // Returns file, span and place of a recording in words.
  #describe(overlay) {
    const place = overlay.crosses ? "its crossing at the trigger" : `its end at ${overlay.end === this.view.zero ? this.zeroName : "the right edge"}`;
    const outside = overlay.isOutside(this.view) ? ", outside the window" : "";
    return `${overlay.name}: wide pale line, ${seconds(overlay.span / this.bench.rate)}, ${place}${outside}`;
  }

  // Returns the selected signals at all visible ticks, as a table in SI units.
  table() {
    const { store } = this;
    const [first, end] = [store.find(this.view.from), store.find(this.view.to + 1)];
    const chosen = this.#shown();
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
    const figures = this.cursors.lines();
    const recordings = this.overlays.map((one) => [[this.#describe(one)]]);
    return [this.#shown().map(({ label, colour }) => [label, colour]), ...recordings, ...figures.map((one) => [[one]])];
  }

  // Draws the lines of the cursors and the trigger, and bands where ticks are missing.
  mark(plot) {
    const { ctx, bbox } = plot;
    const { rate } = this.bench;
    const at = (tick) => plot.valToPos((tick - this.view.zero) / rate, "x", true);
    const line = (tick, colour) => {
      const x = at(tick);
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
      const x = at(first);
      ctx.fillRect(x, bbox.top, Math.max(2, at(last + 1) - x), bbox.height);
    }
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    for (const [n, tick] of this.cursors.ticks.entries()) {
      line(tick, ink("--ink"));
      ctx.fillText("AB"[n], at(tick) + 4, bbox.top + 12 * devicePixelRatio);
    }
    if (this.shot && this.#trigger) line(this.shot.hit, ink("--bad"));
    ctx.restore();
  }

  #controls() {
    this.holdButton = make("button", {
      textContent: "Hold",
      title: "Hold the picture, or follow the newest tick (Space)",
      onclick: () => this.toggle(),
    });
    this.widths = select(
      WINDOWS.map((one) => [String(one), seconds(one)]),
      String(this.window),
    );
    this.widths.onchange = () => this.setWindow(Number(this.widths.value));
    this.widths.id = "window";
    this.overlayList = make("span", { className: "overlays" });
    const arm = (settings) => {
      this.follow();
      this.#trigger = settings && new Trigger(settings);
    };
    this.triggers = new TriggerControls(this.bench, arm, (column) => this.#middle(column));
    this.menu = overlayMenu(this.bench, (file) => this.overlay(file), this.notify);
    this.bar.replaceChildren(this.holdButton, field("Window", this.widths), ...this.triggers.elements, ...this.menu.elements, this.overlayList);
  }

  // Returns the mean of a column over the window, and whether the column is constant there.
  #middle(column) {
    const { live } = this;
    let [sum, count, low, high] = [0, 0, Infinity, -Infinity];
    for (let row = live.find(live.newest - this.window * this.bench.rate); row < live.count; row++) {
      const value = live.value(column, row);
      if (value !== value) continue;
      sum += value;
      count++;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    return { mean: count ? sum / count : 0, isConstant: !(low < high) };
  }

  // Arranges the columns after the signals of the bench have changed.
  arrange(previous) {
    this.live.arrange(previous);
    this.#kept?.arrange(previous);
  }

  // Shows the signals of the bench again after they have changed.
  rebuild() {
    this.triggers.check();
    for (const plot of new Set([this.plot, ...this.plots])) plot.build();
  }

  restyle() {
    for (const plot of this.plots) plot.restyle();
  }
}

// Returns the signals that the scope shows first. A tracking error is invisible next to the long travel.
function usual(bench) {
  const has = (name) => columnOf(bench, name) >= 0;
  const followed = has("error") ? ["error"] : [bench.aim.signal, bench.aim.reference];
  return [...followed, "force", has("current") ? "current" : "voltage"];
}
