// One strip of a time plot: all its signals of one unit over time, with their legend.

import { ink } from "./colours.js";
import { make } from "./dom.js";
import { axisName, sign } from "./names.js";
import { Raster } from "./raster.js";
import { hint, leastSpan, reading } from "./signals.js";
import { Bins } from "./store.js";
import { shown } from "./units.js";
import uPlot from "./uplot/uPlot.esm.js";

const MIN_HEIGHT_PX = 56; // smallest height of a plot, pixels
const LEGEND_PX = 22; // height of the legend above a plot, pixels
const TIME_LABELS_PX = 36; // height of the time labels below the last strip, pixels
const THICKNESS = 1.5;
const OVERLAY_ALPHA = 0.4; // opacity of a recording that is drawn behind the running signals
const OVERLAY_THICKNESS = 6; // its thickness, so that it is visible on both sides of an equal signal
const LETTER_PX = 7; // width of a letter at an axis, pixels
const MAX_MS_WINDOW_S = 0.5; // longest window whose times are shown in ms

export class Strip {
  #raster = new Raster();
  #bins = new Bins();
  #traces = [];
  #overlays = [];

  constructor(plot, unit, signals, isLast) {
    const { scope } = plot;
    this.signals = signals;
    this.scope = scope;
    this.unit = unit;
    this.isLast = isLast;
    this.factor = shown(unit).factor;
    const axis = { stroke: () => ink("--ink"), grid: { stroke: () => ink("--line"), width: 1 } };
    const times = isLast
      ? { label: () => this.#timeName(), labelSize: 18, size: 32, values: (_, at) => at.map((time) => this.#time(time)) }
      : { values: (_, at) => at.map(() => null), ticks: { show: false }, size: 8 };
    this.legend = make("div", { className: "legend" }, ...signals.map((one) => this.#key(plot, one)));
    this.element = make("div", { className: "strip" }, this.legend);
    plot.stripsPlace.append(this.element);
    this.plot = new uPlot(
      {
        width: 600,
        height: MIN_HEIGHT_PX,
        legend: { show: false },
        cursor: { sync: { key: "scope" }, drag: { x: true, y: false, setScale: false } },
        scales: { x: { time: false } },
        axes: [
          { ...axis, ...times },
          { ...axis, label: (of) => this.#axisName(of), size: 66, labelSize: 20, values: marked },
        ],
        series: [{}, { show: false }],
        hooks: {
          setSelect: [(of) => this.#select(of)],
          setCursor: [(of) => scope.point(of.cursor.left >= 0 ? this.#at(of.cursor.left) : null)],
          draw: [(of) => (this.#draw(of), scope.mark(of))],
        },
      },
      [[], []],
      this.element,
    );
    const { over } = this.plot;
    over.addEventListener("dblclick", () => scope.back());
    over.addEventListener("click", (event) => event.detail === 1 && scope.put(this.#at(event.offsetX)));
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      scope.zoomAt(this.#at(event.offsetX), event.deltaY);
    });
  }

  // Returns the legend entry of a signal; it can be dragged to another plot.
  #key(plot, signal) {
    const swatch = make("i", { className: "swatch" });
    swatch.style.background = stroke(signal);
    const value = make("output", { className: "reading" });
    const remove = make("button", { className: "small", textContent: "×", onclick: () => plot.remove(signal.name) });
    remove.setAttribute("aria-label", `remove ${signal.label}`);
    const name = make("span", { textContent: signal.label }, sign(signal.symbol));
    const key = make("span", { className: "key", draggable: true, title: hint(signal) }, swatch, name, value, remove);
    key.ondragstart = (event) => event.dataTransfer.setData("text/plain", signal.name);
    return key;
  }

  // Shows the values of a row in the legend.
  read(store, row) {
    for (const [n, signal] of this.signals.entries())
      this.legend.children[n].querySelector("output").textContent = reading(signal, store.value(signal.column, row));
  }

  static heights(count, all) {
    const height = Math.max(MIN_HEIGHT_PX, Math.floor((all - TIME_LABELS_PX) / Math.max(1, count)) - LEGEND_PX);
    return Array.from({ length: count }, (_, n) => height + (n + 1 === count ? TIME_LABELS_PX : 0));
  }

  resize(width, height) {
    if (this.plot.width !== width || this.plot.height !== height)
      this.plot.setSize({ width, height });
  }

  // Draws the signals and the overlaid recordings between two ticks.
  show(store, { from, to, zero }) {
    const pixels = Math.max(50, Math.round(this.plot.bbox.width / devicePixelRatio));
    const columns = this.signals.map((signal) => signal.column);
    this.#traces = [{ ...store.envelope(columns, from, to, pixels, this.#bins), signals: this.signals, shift: 0 }];
    this.#overlays = this.scope.overlays.map((one) => one.envelope(this.signals, from, to, pixels));
    this.zero = zero;
    const least = leastSpan(this.scope.bench, store, this.unit) * this.factor;
    const { rate } = this.scope.bench;
    const ends = [(from - zero) / rate, (to - zero) / rate];
    const [min, max] = padded([...this.#overlays, ...this.#traces], this.factor, least);
    this.plot.batch(() => {
      this.plot.setData([ends, [null, null]], false);
      this.plot.setScale("x", { min: ends[0], max: ends[1] });
      this.plot.setScale("y", { min, max });
    });
  }

  // Returns the text at the axis of values: the longest one that fits into its height.
  #axisName({ bbox }) {
    const { name } = shown(this.unit);
    const space = bbox.height / devicePixelRatio / LETTER_PX;
    const texts = [axisName(this.signals, this.unit), axisName([], this.unit)].map((text) => (name ? `${text} / ${name}` : text));
    return texts.find((text) => text.length <= space) ?? name;
  }

  #timeName() {
    return `Time from ${this.scope.zeroName} / ${this.#isShort() ? "ms" : "s"}`;
  }

  #isShort() {
    return this.scope.window <= MAX_MS_WINDOW_S;
  }

  #time(value) {
    return String(Number((this.#isShort() ? 1e3 * value : value).toPrecision(6)));
  }

  // Returns the time, s since the start of the bench, at a pixel from the left.
  #at(pixel) {
    return this.plot.posToVal(pixel, "x") + this.zero / this.scope.bench.rate;
  }

  #select(plot) {
    const { left, width } = plot.select;
    if (width < 4) return;
    const [from, to] = [this.#at(left), this.#at(left + width)];
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.scope.zoom(from, to);
  }

  #draw({ ctx, bbox, scales: { x, y } }) {
    const { left, top, width, height } = bbox;
    if (!(width >= 1 && height >= 1 && x.max > x.min)) return;
    const along = width / (x.max - x.min);
    const up = -height / (y.max - y.min);
    this.#raster.begin(Math.ceil(width), Math.ceil(height));
    const { rate } = this.scope.bench;
    const layers = [[this.#overlays, OVERLAY_ALPHA, OVERLAY_THICKNESS], [this.#traces, 1, THICKNESS]];
    for (const [of, alpha, width] of layers) {
      const thickness = Math.round(width * devicePixelRatio);
      for (const { ticks, columns, signals, shift } of of) {
        const a = [along / rate, -along * x.min + (along * (shift - this.zero)) / rate];
        const b = [up * this.factor, -up * y.max];
        for (const [n, signal] of signals.entries())
          this.#raster.line(ticks, columns[n], a, b, { ...signal, alpha }, thickness);
      }
    }
    ctx.drawImage(this.#raster.end(), left, top);
  }
}

// Returns the CSS background of a swatch that shows the line of a signal, with its dashes.
export function stroke({ colour, dash }) {
  if (!dash) return colour;
  const [period, drawn] = dash;
  return `repeating-linear-gradient(90deg, ${colour} 0 ${drawn / 2}px, transparent 0 ${period / 2}px)`;
}

// Returns axis labels with the necessary digits; uPlot itself shows at most three.
function marked(_plot, values, _axis, _space, step) {
  const power = Math.ceil(-Math.log10(step) - 1e-9);
  const isRound = Math.abs(step * 10 ** power - Math.round(step * 10 ** power)) < 1e-6;
  const digits = Math.max(0, power + (isRound ? 0 : 1));
  return values.map((value) => String(Number(value.toFixed(Math.min(digits, 12)))));
}

// Returns the range of the drawn values with a margin, and at least the smallest range.
function padded(traces, factor, least) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of traces.flatMap((one) => one.columns)) {
    for (const value of column) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) return [0, least];
  [low, high] = [low * factor, high * factor];
  const margin = Math.max(0.06 * (high - low), (least - (high - low)) / 2);
  return [low - margin, high + margin];
}
