// The step view: overlays the last steps, coloured by active parameters, with their overshoot, rise and settling times.

import { Plane } from "./canvas.js";
import { COLOURS, ink } from "./colours.js";
import { make } from "./dom.js";
import { columnOf } from "./signals.js";
import { StepFinder } from "./stepfinder.js";
import { show } from "./units.js";

const MAX_STEPS = 24;

export class StepView {
  #steps = [];
  #dirty = true;

  constructor(place, bench, inForce) {
    this.inForce = inForce;
    const find = (name) => columnOf(bench, name);
    this.unit = bench.aim.unit;
    this.finder = new StepFinder(bench, find(bench.aim.reference), find(bench.aim.signal));
    const clear = make("button", { textContent: "Clear", title: "Remove all steps", onclick: () => this.clear() });
    this.hint = make("output", {
      className: "reading",
      textContent: "No steps yet. Set another target while the rig runs, or start the step of the generator.",
    });
    const figure = make("figure");
    this.rows = make("tbody");
    const heads = ["", "Active", "Height", "Overshoot", "Rise 10–90 %", "Settling to 5 %"];
    const head = make("tr", {}, ...heads.map((text) => make("th", { textContent: text })));
    const table = make("table", {}, make("thead", {}, head), this.rows);
    place.replaceChildren(
      make("div", { className: "bar" }, clear, this.hint),
      make("div", { className: "stack" }, figure, make("div", { className: "scroll" }, table)),
    );
    this.plane = new Plane(figure, "Time from the step / ms", "Step / %");
  }

  feed(frame) {
    for (const step of this.finder.feed(frame)) {
      this.#steps = [...this.#steps, { ...step, label: this.inForce(step.tick) }].slice(-MAX_STEPS);
      this.#dirty = true;
    }
  }

  clear() {
    this.#steps = [];
    this.#dirty = true;
  }

  table() {
    const each = (of) => this.#steps.flatMap((step) => step.times.map((_, n) => of(step, n)));
    return {
      tick: each((step) => step.tick),
      t_s: each((step, n) => step.times[n]),
      share: each((step, n) => step.part[n]),
      in_force: each((step) => step.label),
    };
  }

  words() {
    const labels = [...new Set(this.#steps.map((step) => step.label))];
    return [labels.map((label, n) => [label, COLOURS[n % COLOURS.length]])];
  }

  draw() {
    this.plane.begin([-5, 60, -20, 150]);
    this.plane.line([-5, 0, 0, 60], [0, 0, 100, 100], ink("--soft"), 1);
    const labels = [...new Set(this.#steps.map((step) => step.label))];
    for (const step of this.#steps) {
      const colour = COLOURS[labels.indexOf(step.label) % COLOURS.length];
      this.plane.line(
        step.times.map((t) => 1e3 * t),
        step.part.map((p) => 100 * p),
        colour,
        1.3,
        0.8,
      );
    }
    if (this.#dirty) this.#table(labels);
    this.#dirty = false;
  }

  #table(labels) {
    this.hint.hidden = this.#steps.length > 0;
    const rows = labels.map((label, n) => {
      const mine = this.#steps.filter((step) => step.label === label);
      const swatch = make("i", { className: "swatch" });
      swatch.style.background = COLOURS[n % COLOURS.length];
      const cells = [
        `${label} (${mine.length})`,
        spread(
          mine.map((step) => Math.abs(step.height)),
          (value) => show(value, this.unit, 3),
        ),
        spread(
          mine.map((step) => step.overshoot),
          (value) => `${value.toFixed(1)} %`,
        ),
        spread(
          mine.map((step) => step.rise),
          (value) => `${(1e3 * value).toFixed(2)} ms`,
        ),
        spread(
          mine.map((step) => step.settling),
          (value) => `${(1e3 * value).toFixed(1)} ms`,
        ),
      ];
      return make(
        "tr",
        {},
        make("td", {}, swatch),
        ...cells.map((text) => make("td", { textContent: text })),
      );
    });
    this.rows.replaceChildren(...rows);
  }
}

// Returns the mean and the range of the finite values as text.
function spread(values, write) {
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return "–";
  const mean = finite.reduce((sum, one) => sum + one, 0) / finite.length;
  const low = Math.min(...finite);
  const high = Math.max(...finite);
  return low === high ? write(mean) : `${write(mean)} (${write(low)} to ${write(high)})`;
}
