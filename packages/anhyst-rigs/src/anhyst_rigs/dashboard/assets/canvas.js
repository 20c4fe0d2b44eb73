// Plots one quantity over another on a canvas, with axes and lines in their units.

import { ink } from "./colours.js";

const MARGIN = { left: 62, right: 24, top: 12, bottom: 40 };
const CURSOR_STEP = 1 / 100; // distance that an arrow key moves a cursor, relative to the range of x
const SMALL_CURSOR_STEP = 1 / 1000; // the same with Shift

export class Plane {
  yStep = undefined; // distance of the labels at the y axis; undefined: chosen from the range

  // `log`: the values are logarithms, and both axes are labelled in decades; "x": only those of the x axis.
  constructor(place, xLabel, yLabel, log = false) {
    this.log = log;
    this.canvas = document.createElement("canvas");
    place.append(this.canvas);
    Object.assign(this.canvas, { role: "img", ariaLabel: "curves" });
    this.context = this.canvas.getContext("2d");
    this.labels = [xLabel, yLabel];
  }

  // Calls `moved` with the x of a cursor, which follows the pointer and the arrow keys, and with null when it leaves.
  onCursor(moved) {
    const figure = this.canvas.parentElement;
    let cursor = null;
    const move = (x) => {
      cursor = x;
      moved(x);
    };
    Object.assign(figure, { tabIndex: 0, role: "group", ariaLabel: "curves with a cursor, which the arrow keys move" });
    figure.onmousemove = (event) => this.limits && move(this.xAt(event.offsetX));
    figure.onmouseleave = figure.onblur = () => move(null);
    figure.onkeydown = (event) => {
      const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!way || !this.limits) return;
      event.preventDefault();
      const [left, right] = this.limits;
      const step = (right - left) * (event.shiftKey ? SMALL_CURSOR_STEP : CURSOR_STEP);
      move(Math.min(right, Math.max(left, (cursor ?? (left + right) / 2) + way * step)));
    };
  }

  // Starts a picture with the limits [x low, x high, y low, y high].
  begin([left, right, low, high]) {
    const { canvas, context } = this;
    this.limits = [left, right, low, high];
    const name = `${this.labels[1]} over ${this.labels[0]}`;
    if (canvas.ariaLabel !== name) canvas.ariaLabel = name;
    const width = canvas.parentElement.clientWidth;
    const height = canvas.parentElement.clientHeight;
    const ratio = devicePixelRatio;
    if (canvas.width !== Math.floor(width * ratio)) canvas.width = width * ratio;
    if (canvas.height !== Math.floor(height * ratio)) canvas.height = height * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const inner = {
      width: width - MARGIN.left - MARGIN.right,
      height: height - MARGIN.top - MARGIN.bottom,
    };
    this.xAt = (pixel) => left + ((pixel - MARGIN.left) / inner.width) * (right - left);
    this.x = (value) => MARGIN.left + ((value - left) / (right - left)) * inner.width;
    this.y = (value) => MARGIN.top + ((high - value) / (high - low)) * inner.height;
    this.#axes(left, right, low, high, width, height);
  }

  line(xs, ys, colour, width = 1.5, alpha = 1) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(
      MARGIN.left,
      MARGIN.top,
      this.canvas.clientWidth - MARGIN.left - MARGIN.right,
      this.canvas.clientHeight - MARGIN.top - MARGIN.bottom,
    );
    context.clip();
    context.beginPath();
    for (let i = 0; i < xs.length; i++) context.lineTo(this.x(xs[i]), this.y(ys[i]));
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.globalAlpha = alpha;
    context.stroke();
    context.restore();
  }

  // Fills the area between two lines with a light colour.
  band(xs, lows, highs, colour, alpha) {
    const { context } = this;
    context.save();
    context.beginPath();
    for (let i = 0; i < xs.length; i++) context.lineTo(this.x(xs[i]), this.y(lows[i]));
    for (let i = xs.length - 1; i >= 0; i--) context.lineTo(this.x(xs[i]), this.y(highs[i]));
    context.fillStyle = colour;
    context.globalAlpha = alpha;
    context.fill();
    context.restore();
  }

  // Draws a background that rarely changes: `draw` is called only if the key or the axes have changed.
  backdrop(key, draw) {
    const { canvas, context } = this;
    const full = [key, canvas.width, canvas.height, this.limits, ink("--ink")].join();
    if (this.drawnKey !== full) {
      this.drawnKey = full;
      this.aside ??= document.createElement("canvas");
      this.aside.width = canvas.width;
      this.aside.height = canvas.height;
      this.context = this.aside.getContext("2d");
      this.context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
      draw();
      this.context = context;
    }
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.aside, 0, 0);
    context.restore();
  }

  dot(x, y, colour) {
    const { context } = this;
    context.beginPath();
    context.arc(this.x(x), this.y(y), 4, 0, 7);
    context.fillStyle = colour;
    context.fill();
  }

  #axes(left, right, low, high, width, height) {
    const { context } = this;
    context.font = "12px system-ui, sans-serif";
    context.fillStyle = ink("--ink");
    context.strokeStyle = ink("--line");
    context.lineWidth = 1;
    context.beginPath();
    context.textAlign = "center";
    const steps = (axis) => (this.log === true || this.log === axis ? decades : marks);
    const text = (value, axis) => label(steps(axis) === decades ? 10 ** value : value);
    for (const value of steps("x")(left, right)) {
      context.moveTo(this.x(value), MARGIN.top);
      context.lineTo(this.x(value), height - MARGIN.bottom);
      context.fillText(text(value, "x"), this.x(value), height - MARGIN.bottom + 16);
    }
    context.fillText(this.labels[0], (MARGIN.left + width) / 2, height - 6);
    context.textAlign = "right";
    for (const value of steps("y")(low, high, this.yStep)) {
      context.moveTo(MARGIN.left, this.y(value));
      context.lineTo(width - MARGIN.right, this.y(value));
      context.fillText(text(value, "y"), MARGIN.left - 6, this.y(value) + 4);
    }
    context.stroke();
    context.save();
    context.translate(14, (height - MARGIN.bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(this.labels[1], 0, 0);
    context.restore();
  }
}

function label(value) {
  return String(Number(value.toPrecision(6)));
}

// Returns about six round numbers within a range, or the multiples of a step.
export function marks(low, high, step = roundStep((high - low) / 6)) {
  const found = [];
  for (let n = Math.ceil(low / step); n * step <= high; n++) found.push(n * step);
  return found;
}

function roundStep(raw) {
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 5, 10].find((one) => one * power >= raw) * power;
}

function decades(low, high) {
  const first = Math.ceil(low);
  return Array.from({ length: Math.max(0, Math.floor(high) - first + 1) }, (_, n) => first + n);
}

// Returns the range of some columns, with a margin.
export function limits(...columns) {
  let low = Infinity;
  let high = -Infinity;
  for (const column of columns) {
    for (const value of column) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [0, 1];
  const margin = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1;
  return [low - margin, high + margin];
}

// Returns a range that has at least a given width, about the same middle.
export function atLeast([low, high], width) {
  const margin = Math.max(0, (width - (high - low)) / 2);
  return [low - margin, high + margin];
}
