// The step view: overlays the last steps, coloured by active parameters, with their overshoot, rise and settling times.

import { Plane } from "./canvas.js";
import { COLOURS, ink } from "./colours.js";
import { make } from "./dom.js";
import { show } from "./units.js";

export class StepView {
  #shown = null; // the steps in the table
  #key = ""; // size and theme of the drawn picture

  constructor(place, bench, finder) {
    this.unit = bench.aim.unit;
    this.finder = finder;
    const clear = make("button", { textContent: "Clear", title: "Remove all steps", onclick: () => (finder.steps = []) });
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
      make("div", { className: "stack" }, figure, make("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: "figures of the steps" }, table)),
    );
    this.plane = new Plane(figure, "Time from the step / ms", "Step / %");
  }

  table() {
    const each = (of) => this.finder.steps.flatMap((step) => step.times.map((_, n) => of(step, n)));
    return {
      tick: each((step) => step.tick),
      t_s: each((step, n) => step.times[n]),
      share: each((step, n) => step.part[n]),
      in_force: each((step) => step.label),
    };
  }

  words() {
    const labels = [...new Set(this.finder.steps.map((step) => step.label))];
    return [labels.map((label, n) => [label, COLOURS[n % COLOURS.length]])];
  }

  draw() {
    const { steps } = this.finder;
    const { clientWidth, clientHeight } = this.plane.canvas.parentElement;
    const key = `${clientWidth} ${clientHeight} ${document.documentElement.dataset.theme}`;
    if (steps === this.#shown && key === this.#key) return;
    [this.#shown, this.#key] = [steps, key];
    this.plane.begin([-5, 60, -20, 150]);
    this.plane.line([-5, 0, 0, 60], [0, 0, 100, 100], ink("--soft"), 1);
    const labels = [...new Set(steps.map((step) => step.label))];
    for (const step of steps) {
      const colour = COLOURS[labels.indexOf(step.label) % COLOURS.length];
      const times = step.times.map((t) => 1e3 * t);
      const percents = step.part.map((p) => 100 * p);
      this.plane.line(times, percents, colour, 1.3, 0.8);
    }
    this.#table(labels);
  }

  #table(labels) {
    this.hint.hidden = this.finder.steps.length > 0;
    const rows = labels.map((label, n) => {
      const mine = this.finder.steps.filter((step) => step.label === label);
      const swatch = make("i", { className: "swatch" });
      swatch.style.background = COLOURS[n % COLOURS.length];
      const column = (of, write) => spread(mine.map(of), write);
      const cells = [
        `${label} (${mine.length})`,
        column((step) => Math.abs(step.height), (value) => show(value, this.unit, 3)),
        column((step) => step.overshoot, (value) => `${value.toFixed(1)} %`),
        column((step) => step.rise, (value) => `${(1e3 * value).toFixed(2)} ms`),
        column((step) => step.settling, (value) => `${(1e3 * value).toFixed(1)} ms`),
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
