// One strip of the scope: all chosen signals of one unit over time.

import uPlot from "./uplot/uPlot.esm.js";
import { shown } from "./units.js";

const HEIGHT_LEAST = 90;

// Okabe and Ito: distinct for every kind of colour vision, on white and on black.
export const COLOURS = [
  "#0072b2",
  "#d55e00",
  "#009e73",
  "#cc79a7",
  "#e69f00",
  "#56b4e9",
  "#8c8c8c",
  "#b8a800",
];

export function ink(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export class Strip {
  constructor(place, unit, signals, scope) {
    this.signals = signals;
    const { name, factor, least } = shown(unit);
    this.factor = factor;
    const axis = { stroke: () => ink("--ink"), grid: { stroke: () => ink("--line"), width: 1 } };
    this.plot = new uPlot(
      {
        width: 600,
        height: HEIGHT_LEAST,
        legend: { show: false },
        cursor: { sync: { key: "scope" }, drag: { x: true, y: false, setScale: false } },
        scales: { x: { time: false }, y: { range: (plot) => padded(plot, least) } },
        axes: [
          { ...axis, label: scope.isLast(unit) ? "t / s" : undefined, labelSize: 18, size: 32 },
          { ...axis, label: name || "number", size: 66, labelSize: 20 },
        ],
        series: [
          {},
          ...signals.map((signal) => ({
            label: signal.name,
            stroke: signal.colour,
            width: 1.5,
            points: { show: false },
          })),
        ],
        hooks: {
          setSelect: [(plot) => scope.zoom(plot)],
          setCursor: [(plot) => scope.point(plot)],
          draw: [(plot) => scope.mark(plot)],
        },
      },
      [[], ...signals.map(() => [])],
      place,
    );
    this.plot.over.addEventListener("dblclick", () => scope.follow());
    this.plot.over.addEventListener("click", () => scope.anchor());
  }

  resize(width, height) {
    if (this.plot.width !== width || this.plot.height !== height)
      this.plot.setSize({ width, height });
  }

  show(seconds, columns, from, to) {
    const scaled = columns.map((column) =>
      Array.from(column, (value) => (value === null ? null : value * this.factor)),
    );
    this.plot.batch(() => {
      this.plot.setData([seconds, ...scaled], false);
      this.plot.setScale("x", { min: from, max: to });
      this.plot.setScale("y", { min: null, max: null });
    });
  }
}

// The range of what is drawn, with a margin, and never less than the least.
function padded(plot, least) {
  const values = plot.data.slice(1).flatMap((column) => extremes(column));
  if (!values.length) return [0, least];
  const low = Math.min(...values);
  const high = Math.max(...values);
  const margin = Math.max(0.06 * (high - low), (least - (high - low)) / 2);
  return [low - margin, high + margin];
}

function extremes(column) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of column) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low > high ? [] : [low, high];
}
