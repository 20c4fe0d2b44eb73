// The step view: overlays the last steps, coloured by active parameters, with their overshoot, rise and settling times.

import { Plane } from "./canvas.js";
import { COLOURS, ink } from "./colours.js";
import { make } from "./dom.js";
import { AFTER_S } from "./stepfinder.js";
import { signalOf } from "./signals.js";
import { show } from "./units.js";

const HEADS = ["Settings", "Height", "Noise before", "Overshoot", "Rise 10–90 %", "Settling to 5 %"];
const MIN_SHOWN_S = 0.005; // shortest time axis
const HINT = "No steps yet. Set another target while the rig runs, or start the step of the generator.";
const MOVING_HINT = "No steps yet. A step needs a reference that is constant before and after it; a running motion has none.";
const UNCHANGED = "A gain × 1 has the value that it had when the server was started.";
const TIMES = " × "; // between the name of a gain and its factor, in the label of a setting

export class StepView {
  #shown = null; // the steps in the table
  #key = ""; // size and theme of the drawn picture

  constructor(place, bench, finder) {
    this.unit = bench.aim.unit;
    this.finder = finder;
    const clear = make("button", { textContent: "Clear", title: "Remove all steps", onclick: () => finder.clear() });
    this.hint = make("output", {
      className: "reading",
      textContent: bench.aim.is_offset ? MOVING_HINT : HINT,
    });
    const figure = make("figure");
    this.rows = make("tbody");
    const head = make("tr", {}, ...["", ...HEADS].map((text) => make("th", { textContent: text })));
    head.children[3].title = "Four standard deviations in the last 10 to 50 ms before the step";
    this.note = make("p", { className: "soft", textContent: UNCHANGED, hidden: true });
    const table = make("table", {}, make("thead", {}, head), this.rows);
    place.replaceChildren(
      make("div", { className: "bar" }, clear, this.hint),
      make("div", { className: "stack" }, figure, make("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: "figures of the steps" }, table, this.note)),
    );
    this.plane = new Plane(figure, "Time from the step / ms", `${signalOf(bench, bench.aim.signal).label} / % of the step`);
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
    const rows = this.#cells().map((cells, n) => cells.map((cell, m) => [m ? `${HEADS[m]}: ${cell}` : cell, COLOURS[n]]));
    return this.note.hidden ? rows : [...rows, [[UNCHANGED]]];
  }

  draw() {
    const { steps } = this.finder;
    const { clientWidth, clientHeight } = this.plane.canvas.parentElement;
    const key = `${clientWidth} ${clientHeight} ${document.documentElement.dataset.theme}`;
    if (steps === this.#shown && key === this.#key) return;
    [this.#shown, this.#key] = [steps, key];
    const end = shownTime(steps);
    this.plane.begin([-end / 12, end, -20, 150]);
    this.plane.line([-end / 12, 0, 0, end], [0, 0, 100, 100], ink("--soft"), 1);
    for (const step of steps) {
      const colour = COLOURS[this.finder.settings.indexOf(step.label)];
      const times = step.times.map((t) => 1e3 * t);
      const percents = step.part.map((p) => 100 * p);
      this.plane.line(times, percents, colour, 1.3, 0.8);
    }
    this.#table();
  }

  #table() {
    this.hint.hidden = this.finder.steps.length > 0;
    const rows = this.#cells().map((cells, n) => {
      const swatch = make("i", { className: "swatch" });
      swatch.style.background = COLOURS[n];
      return make("tr", {}, make("td", {}, swatch), ...cells.map(cell));
    });
    this.rows.replaceChildren(...rows);
    this.note.hidden = !this.finder.settings.some((label) => label.includes(TIMES));
  }

  // Returns the texts of the table, one row for each setting.
  #cells() {
    const { settings, steps } = this.finder;
    const names = inFull(settings);
    return settings.map((label, n) => {
      const mine = steps.filter((step) => step.label === label);
      const column = (of, write, failure = "") => spread(mine.map(of), write, failure);
      const percent = (value) => `${value.toFixed(1)} %`;
      const noise = Math.max(...mine.map((step) => step.noise));
      const hasOvershoot = mine.reduce((sum, step) => sum + step.overshoot - step.noise, 0) > 0; // in the mean
      return [
        `${names[n]}, ${mine.length} ${mine.length === 1 ? "step" : "steps"}`,
        signs(mine) + column((step) => Math.abs(step.height), (value) => show(value, this.unit, 3)),
        column((step) => step.noise, percent),
        hasOvershoot ? column((step) => step.overshoot, percent) : `none above the noise of ${percent(noise)}`,
        column((step) => step.rise, (value) => `${(1e3 * value).toFixed(2)} ms`, "did not rise to 90 %"),
        column((step) => step.settling, (value) => `${(1e3 * value).toFixed(1)} ms`, "did not settle"),
      ];
    });
  }
}

// Returns the sign of the heights of some steps: ± if it differs.
function signs(steps) {
  const upward = steps.filter((step) => step.height > 0).length;
  if (upward === steps.length) return "+";
  return upward ? "±" : "−";
}

// Returns the end of the time axis, ms: three times the longest settling time, if all steps settled.
function shownTime(steps) {
  const settling = Math.max(0, ...steps.map((step) => (Number.isFinite(step.settling) ? step.settling : AFTER_S)));
  return 1e3 * Math.min(AFTER_S, Math.max(MIN_SHOWN_S, 3 * settling));
}

// Returns the labels of settings. Each states all factors of gains that any of them states, also a factor of 1.
function inFull(labels) {
  const gains = (label) => label.split(", ").filter((part) => part.includes(TIMES)).map((part) => part.split(TIMES)[0]);
  const all = [...new Set(labels.flatMap(gains))];
  return labels.map((label) => [label, ...all.filter((gain) => !gains(label).includes(gain)).map((gain) => `${gain}${TIMES}1`)].join(", "));
}

// Returns a cell of the table. A line may break before a range or a failure, and everywhere in the first column.
function cell(text, n) {
  const parts = text.split(/ (?=\()|(?<=;) /).flatMap((part) => [" ", make("span", { textContent: part })]);
  return make("td", {}, ...(n ? parts.slice(1) : [text]));
}

// Returns the mean and the range of the finite values as text, and how many others there are, as a failure in words.
function spread(values, write, failure) {
  const finite = values.filter(Number.isFinite);
  const others = values.length - finite.length;
  if (others) return [finite.length ? spread(finite, write) : "–", `${others} of ${values.length} ${failure}`].join("; ");
  const mean = finite.reduce((sum, one) => sum + one, 0) / finite.length;
  const low = write(Math.min(...finite));
  const high = write(Math.max(...finite));
  return low === high ? low : `${write(mean)} (${low} to ${high})`;
}
