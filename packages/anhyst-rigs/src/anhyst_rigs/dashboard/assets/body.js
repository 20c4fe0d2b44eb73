// The body view of a stage: magnets and heads at their positions in the rig file, the pose magnified,
// and the forces as arrows. A panel shows wrench, errors, gaps and forces as numbers and bars.

import { COLOURS, ink } from "./colours.js";
import { Figures, numbered } from "./bodyfigures.js";
import { field, make, select } from "./dom.js";
import { columnOf } from "./signals.js";
import { Space } from "./space.js";
import { show } from "./units.js";

const MAGNIFICATIONS = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7];
const MAX_MAGNIFICATION = 1e6; // largest magnification that is selected automatically
const DRAWN_MOTION_RATIO = 0.16; // largest drawn motion in automatic magnification, relative to the body's size
const MOTION_DECAY_S = 3; // time constant with which an earlier motion decays
const LONGEST_ARROW_RATIO = 0.8; // length of the arrow of the largest force, relative to the body's size
const MIN_EDGE_RATIO = 0.25; // smallest edge of the box, as a fraction of its largest
const DEFAULT_SIZE_M = 0.1; // size of the body, m, if all magnets and heads have the same position
const REFERENCE_TEXTS = {
  error: ["error against the set-point", "at its set-point"],
  gap: ["position in the gaps", "in the middle of its gaps"],
};
const SIDES = [0, 1, 2].flatMap((axis) => [0, 1].map((side) => [axis, side]));

export class BodyView {
  #moved = 0; // recent motion of the corners, m; decays with MOTION_DECAY_S
  #drawnAt = 0;

  constructor(place, bench, store) {
    this.bench = bench;
    this.store = store;
    this.body = bench.body;
    this.shape = boxOf(bench.body);
    const { choices } = bench;
    const kept = (name, options, otherwise) => {
      const element = select(options, choices.get(name, otherwise));
      element.id = name;
      element.onchange = () => choices.set(name, element.value);
      return element;
    };
    this.what = kept("pose", Object.entries(REFERENCE_TEXTS).map(([name, [text]]) => [name, text]), "error");
    const factors = MAGNIFICATIONS.map((one) => [String(one), spaced(one)]);
    this.times = kept("exaggerated", [["auto", "automatically"], ...factors], "auto");
    const figure = make("figure");
    this.figures = new Figures(bench, store);
    place.replaceChildren(
      make(
        "div",
        { className: "bar" },
        field("Pose", this.what),
        field("Exaggerated", this.times),
        make("span", { className: "soft", textContent: "Drag or use the arrow keys to rotate; Home resets the view" }),
      ),
      make("div", { className: "beside" }, figure, this.figures.place),
    );
    this.space = new Space(figure, "the body, its magnets and their forces");
    this.factor = 1;
  }

  draw() {
    if (!this.store.count) return;
    const [way, turn] = this.pose();
    const by = (point) => sum(way, cross(turn, point));
    const { middle, size, corners } = this.shape;
    this.#choose(Math.max(...corners.map((one) => Math.hypot(...by(one)))));
    const moved = (point) => sum(point, times(this.factor, by(point)));
    this.space.begin(sum(middle, [0, 0, -0.12 * size]), 1.25 * size);
    this.#stroke();
    this.#box(corners, ink("--soft"), false);
    const before = (one) => this.space.faces(minus(one.at, middle));
    const { magnets } = this.body;
    for (const [n, one] of magnets.entries()) if (!before(one)) this.#magnet(one, n, moved);
    this.#box(corners.map(moved), ink("--blue"), true);
    for (const one of this.body.heads) this.#head(one, moved);
    for (const [n, one] of magnets.entries()) if (before(one)) this.#magnet(one, n, moved);
    this.#notes();
    this.figures.draw();
  }

  // Returns the drawn displacement and rotation, m and rad; 0 for a fixed coordinate.
  pose() {
    const { free, see, magnets } = this.body;
    const opened = magnets.map((one, n) => this.#last(numbered("gap", n)) - one.gap);
    const found = new Map(
      free.map((axis, k) => [
        axis,
        this.what.value === "gap" ? -dot(see[k], opened) : -this.#last(`error_${axis}`),
      ]),
    );
    return [["x", "y", "z"], ["rx", "ry", "rz"]].map((axes) => axes.map((axis) => found.get(axis) ?? 0));
  }

  table() {
    return this.figures.table();
  }

  words() {
    return this.figures.words();
  }

  #last(name) {
    return this.store.value(columnOf(this.bench, name), this.store.count - 1);
  }

  // Selects the magnification, 1, 2 or 5 times a power of ten, that makes recent motion visible.
  #choose(moves) {
    const now = performance.now();
    this.#moved = Math.max(moves, Math.exp((this.#drawnAt - now) / (1e3 * MOTION_DECAY_S)) * this.#moved);
    this.#drawnAt = now;
    if (this.times.value !== "auto") {
      this.factor = Number(this.times.value);
      return;
    }
    const most = Math.max(1, Math.min(MAX_MAGNIFICATION, (DRAWN_MOTION_RATIO * this.shape.size) / this.#moved));
    if (this.factor > most || this.factor < most / 4) {
      const power = 10 ** Math.floor(Math.log10(most));
      this.factor = power * [5, 2, 1].find((one) => one * power <= most);
    }
  }

  #box(corners, colour, solid) {
    for (const [axis, side] of SIDES) {
      const face = corners.filter((_, n) => ((n >> axis) & 1) === side);
      const round = [face[0], face[1], face[3], face[2], face[0]];
      const seen = this.space.faces([0, 1, 2].map((one) => (one === axis ? 2 * side - 1 : 0)));
      if (solid && seen) this.space.face(round, colour, 0.16);
      if (solid && seen) this.space.line(round, colour, 2);
      else this.space.line(round, colour, 1, [2, 4]);
    }
  }

  // Draws a magnet: its pole face on the long stroke, and the force with which it pulls the body.
  #magnet({ name, at, direction }, n, moved) {
    const { size } = this.shape;
    const pole = sum(at, times(0.2 * size, direction));
    const [a, b] = across(direction).map((side) => times(0.06 * size, side));
    const face = [sum(sum(pole, a), b), sum(minus(pole, a), b), minus(minus(pole, a), b), minus(sum(pole, a), b)];
    this.space.face(face, ink("--soft"), 0.3);
    this.space.line([...face, face[0]], ink("--soft"));
    const from = moved(at);
    const long = (LONGEST_ARROW_RATIO * size * this.#last(numbered("pull", n))) / this.body.force;
    this.space.arrow(from, sum(from, times(long, direction)), COLOURS[1]);
    this.space.text(name, sum(pole, times(0.1 * size, minus(direction, [0, 0, 0.6]))));
  }

  #head({ at, direction }, moved) {
    const from = moved(at);
    this.space.line([from, minus(from, times(0.07 * this.shape.size, direction))], COLOURS[2], 4);
  }

  // Draws the travel of the long stroke below the body, at a separate scale, and the axes.
  #stroke() {
    const { middle, size, corners } = this.shape;
    const { along, way } = this.body;
    const low = corners[0];
    const below = [middle[0], middle[1], low[2] - 0.3 * size];
    const on = (part) => sum(below, times(0.7 * size * part, along));
    this.space.line([on(-1), on(1)], ink("--soft"));
    const here = Math.max(-1, Math.min(1, this.#last("reference") / way));
    this.space.line([on(here - 0.1), on(here + 0.1)], ink("--soft"), 7);
    const corner = [low[0] - 0.3 * size, low[1] - 0.2 * size, below[2]];
    for (const [n, axis] of ["x", "y", "z"].entries()) {
      const unit = [0, 1, 2].map((one) => (one === n ? size : 0));
      this.space.arrow(corner, sum(corner, times(0.2, unit)), ink("--soft"), 1.5);
      this.space.text(axis, sum(corner, times(0.27, unit)), ink("--soft"));
    }
  }

  // Describes the picture in words, next to it and for screen readers.
  #notes() {
    const { force, way } = this.body;
    const [text, thin] = REFERENCE_TEXTS[this.what.value];
    const shown = 10 ** Math.floor(Math.log10(force)); // N
    const long = (LONGEST_ARROW_RATIO * this.shape.size * this.space.scale * shown) / force;
    const millimetres = (metres) => (1e3 * metres).toFixed(2);
    const exaggerated = `${text} × ${spaced(this.factor)}`;
    this.space.canvas.title = exaggerated;
    this.space.note(exaggerated, 3);
    this.space.note(`dotted: the body ${thin}; gaps are not to scale`, 2);
    this.space.note(`pull of ${show(shown, "N")} across the view; green: position heads`, 1, long, COLOURS[1]);
    this.space.note(`long stroke: ${millimetres(this.#last("reference"))} mm of ± ${millimetres(way)} mm`, 0);
  }
}

// Returns a box around all magnets and heads; corner n is at the high end of axis k if bit k of n is set.
function boxOf({ magnets, heads }) {
  const places = [...magnets, ...heads].map((one) => one.at);
  const [low, high] = [Math.min, Math.max].map((pick) => [0, 1, 2].map((k) => pick(...places.map((at) => at[k]))));
  const middle = times(0.5, sum(low, high));
  const edges = minus(high, low);
  const size = Math.max(...edges) || DEFAULT_SIZE_M;
  const half = edges.map((edge) => 0.5 * Math.max(edge, MIN_EDGE_RATIO * size));
  const corners = Array.from({ length: 8 }, (_, n) => middle.map((at, k) => at + ((n >> k) & 1 ? half[k] : -half[k])));
  return { middle, size, corners };
}

const sum = (a, b) => a.map((one, k) => one + b[k]);
const minus = (a, b) => a.map((one, k) => one - b[k]);
const times = (factor, a) => a.map((one) => factor * one);
const dot = (a, b) => a.reduce((total, one, k) => total + one * b[k], 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

// Returns two directions perpendicular to the given one and to each other.
function across(direction) {
  const other = Math.abs(direction[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const side = cross(direction, other);
  const unit = times(1 / Math.hypot(...side), side);
  return [unit, cross(direction, unit)];
}

const spaced = (value) => value.toLocaleString("en").replaceAll(",", "\u202f");
