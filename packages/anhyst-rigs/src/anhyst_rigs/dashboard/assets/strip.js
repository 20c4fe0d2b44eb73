// One strip of the scope: all chosen signals of one unit over time.

import { ink } from "./colours.js";
import { Raster } from "./raster.js";
import { shown } from "./units.js";
import uPlot from "./uplot/uPlot.esm.js";

const MIN_HEIGHT_PX = 64; // smallest height, pixels
const TIME_LABELS_PX = 24; // height of the time labels below the last strip, pixels
const THICKNESS = 1.5;

export class Strip {
  #raster = new Raster();
  #trace = { ticks: [], columns: [] };

  constructor(place, unit, signals, scope, isLast) {
    this.signals = signals;
    this.rate = scope.bench.rate;
    this.isLast = isLast;
    const { name, factor, least } = shown(unit);
    this.factor = factor;
    this.least = least;
    const axis = { stroke: () => ink("--ink"), grid: { stroke: () => ink("--line"), width: 1 } };
    const times = isLast
      ? { label: "t / s", labelSize: 18, size: 32 }
      : { values: (_, at) => at.map(() => null), ticks: { show: false }, size: 8 };
    this.plot = new uPlot(
      {
        width: 600,
        height: MIN_HEIGHT_PX,
        legend: { show: false },
        cursor: { sync: { key: "scope" }, drag: { x: true, y: false, setScale: false } },
        scales: { x: { time: false } },
        axes: [
          { ...axis, ...times },
          { ...axis, label: name || "number", size: 66, labelSize: 20, values: marked },
        ],
        series: [{}, { show: false }],
        hooks: {
          setSelect: [(plot) => scope.zoom(plot)],
          setCursor: [(plot) => scope.point(plot)],
          draw: [(plot) => (this.#draw(plot), scope.mark(plot))],
        },
      },
      [[], []],
      place,
    );
    const time = (event) => this.plot.posToVal(event.offsetX, "x");
    const { over } = this.plot;
    over.addEventListener("dblclick", () => scope.back());
    over.addEventListener("click", (event) => event.detail === 1 && scope.put(time(event)));
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      scope.zoomAt(time(event), event.deltaY);
    });
  }

  static heights(count, all) {
    const height = Math.max(MIN_HEIGHT_PX, Math.floor((all - TIME_LABELS_PX) / count));
    return Array.from({ length: count }, (_, n) => height + (n + 1 === count ? TIME_LABELS_PX : 0));
  }

  resize(width, height) {
    if (this.plot.width !== width || this.plot.height !== height)
      this.plot.setSize({ width, height });
  }

  // Shows the ticks and columns of an envelope between two ticks.
  show(trace, from, to) {
    this.#trace = trace;
    const ends = [from / this.rate, to / this.rate];
    const [min, max] = padded(trace.columns, this.factor, this.least);
    this.plot.batch(() => {
      this.plot.setData([ends, [null, null]], false);
      this.plot.setScale("x", { min: ends[0], max: ends[1] });
      this.plot.setScale("y", { min, max });
    });
  }

  #draw({ ctx, bbox, scales: { x, y } }) {
    const { left, top, width, height } = bbox;
    if (!(width >= 1 && height >= 1 && x.max > x.min)) return;
    const along = width / (x.max - x.min);
    const up = -height / (y.max - y.min);
    const thickness = Math.round(THICKNESS * devicePixelRatio);
    this.#raster.begin(Math.ceil(width), Math.ceil(height));
    for (const [n, { colour }] of this.signals.entries()) {
      const column = this.#trace.columns[n] ?? [];
      const a = [along / this.rate, -along * x.min];
      const b = [up * this.factor, -up * y.max];
      this.#raster.line(this.#trace.ticks, column, a, b, colour, thickness);
    }
    ctx.drawImage(this.#raster.end(), left, top);
  }
}

// Returns axis labels with the necessary digits; uPlot itself shows at most three.
function marked(_plot, values, _axis, _space, step) {
  const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9) + (step < 1 ? 1 : 0));
  return values.map((value) => String(Number(value.toFixed(Math.min(digits, 12)))));
}

// Returns the range of the drawn values with a margin, and at least the minimum range.
function padded(columns, factor, least) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of columns) {
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
