// The improve view: a button for each of measure, identify, compile and swap, with its result.

import { Plane, limits } from "./canvas.js";
import { BLUE, VERMILION, ink } from "./colours.js";
import { download, field, make, refuse } from "./dom.js";
import { words } from "./names.js";
import { Watch } from "./watch.js";

const OLD_MODEL_COLOUR = VERMILION;
const NEW_MODEL_COLOUR = BLUE;
const LIMITS = [
  ["current_A", "current", "A"],
  ["rate_A_per_s", "rate", "A/s"],
  ["force_N", "force", "N"],
];
const STEPS = ["measure", "identify", "compile", "swap"];

const HINT =
  "Four steps improve the model of this rig. Measure drives the current through loops and records the force. Identify finds a new model from these loops and compares it with the active one. Compile converts the new model for the controller. Swap activates it while the rig runs, and Swap back restores the previous model. Start with Measure.";

export class Improve {
  #results;
  #shown = ""; // key of the drawn content and its size

  constructor(place, bench, order) {
    this.order = order;
    if (!bench.limits) {
      place.replaceChildren(make("p", { className: "empty", textContent: "This rig was not opened from a rig file, so it cannot measure loops." }));
      return;
    }
    this.buttons = Object.fromEntries(STEPS.map((step) => [step, this.#button(step)]));
    this.cancel = make("button", { textContent: "Cancel", title: "End the running step", onclick: () => order("improve", { step: "cancel" }) });
    this.back = make("button", { textContent: "Swap back", title: "Activate the previous model again", onclick: () => this.#swap("back") });
    this.save = make("button", { textContent: "Save files", title: "Save the measured loops and the model", onclick: () => this.#files() });
    this.now = make("output", { className: "reading", id: "improving" });
    this.bar = make("progress", { max: 1, value: 0, hidden: true });
    this.figures = make("div", { className: "scroll figures", tabIndex: 0, role: "region", ariaLabel: "figures" });
    const left = make("figure");
    const right = make("figure");
    this.plots = make("div", { className: "pair" }, left, right);
    this.left = new Plane(left, "", "");
    this.right = right;
    this.loops = new Plane(right, "current / A", "force / N");
    this.watch = new Watch(order);
    place.replaceChildren(
      make("div", { className: "bar" }, ...this.#limits(bench.limits)),
      make(
        "div",
        { className: "bar" },
        ...Object.values(this.buttons),
        this.back,
        this.cancel,
        this.save,
        this.bar,
        this.now,
      ),
      this.figures,
      this.plots,
      this.watch.element,
    );
    this.show(bench.results);
  }

  #button(step) {
    const number = STEPS.indexOf(step) + 1;
    const begin = () => (step === "swap" ? this.#swap(step) : this.#begin(step));
    return make("button", { textContent: `${number}. ${words(step)}`, onclick: begin });
  }

  // Shows the limits of the rig file, which the user can tighten, and the thermal limit of the winding.
  #limits({ gaps_m: gaps, winding, ...bounds }) {
    this.inputs = {};
    const fields = LIMITS.map(([name, text, unit]) => {
      const { value, key } = bounds[name];
      const input = make("input", { type: "number", step: "any", className: "number" });
      input.value = short(value);
      input.title = `at most ${short(value)} ${unit}, the limit of the rig file (${key})`;
      input.setAttribute("aria-label", `largest ${text}`);
      this.inputs[name] = { input, most: value };
      return field(text, input, unit);
    });
    const warm = winding
      ? `Thermal limit of the winding (I²t): ${short(winding.continuous_A)} A permanently, time constant ${short(winding.thermal_s)} s.`
      : "The rig file states no thermal limit of the winding.";
    const where = gaps.map((gap) => short(1e3 * gap)).join(", ");
    const measured = gaps.length ? ` Loops are measured at ${gaps.length > 1 ? "the gaps" : "the gap"} ${where} mm.` : "";
    return [...fields, make("span", { className: "soft", textContent: warm + measured })];
  }

  #begin(step) {
    const tighter = {};
    for (const [name, { input, most }] of Object.entries(this.inputs)) {
      const value = Number(input.value);
      if (short(value) !== short(most)) tighter[name] = value;
    }
    return this.order("improve", { step, ...(step === "measure" ? { limits: tighter } : {}) });
  }

  async #swap(step) {
    const answer = await this.order("improve", { step });
    if (answer) this.swapped = `${step === "swap" ? "new model" : "model before"} in force from tick ${answer.applied} on`;
  }

  async #files() {
    const answer = await this.order("improve", { step: "files" });
    for (const [name, text] of Object.entries(answer?.files ?? {})) download(name, new Blob([text]));
  }

  // Shows the results of the steps.
  show(results) {
    if (!this.now) return;
    this.#results = results;
    this.#shown = "";
    this.right.hidden = !results.identify;
    this.figures.replaceChildren(...this.#tables(results));
  }

  status({ improve, watch, refused }) {
    if (!this.now || !improve) return;
    const { step, share, seconds, trouble } = improve;
    this.bar.hidden = !step;
    this.bar.value = share;
    const senders = { ...this.buttons, cancel: this.cancel, back: this.back, files: this.save };
    for (const [name, button] of Object.entries(senders))
      refuse(button, refused.improve || improve.refused[name]);
    this.watch.refuse(refused.improve || improve.refused.watch);
    this.now.textContent = step
      ? `${step}: ${Math.round(100 * share)} %, ${Math.round(seconds)} s`
      : trouble || this.swapped || "";
    this.watch.show(watch);
  }

  #tables({ measure, identify, compile }) {
    const lines = [];
    if (measure) {
      const isQuick = measure.took_s < measure.duration_s;
      const quick = isQuick ? ` (the virtual rig ran faster than real time and took ${Number(measure.took_s.toPrecision(2))} s)` : "";
      const warm = measure.warmth === null ? "" : `, I²t at most ${Math.round(100 * measure.warmth)} %`;
      lines.push(
        `${measure.loops} loops, ${measure.samples} samples, ${short(measure.duration_s / 60)} min of the rig's time${quick}${warm}`,
        ...measure.notes,
      );
    }
    if (compile)
      lines.push(
        `The compiled block deviates from the model by at most ${short(compile.worst_N)} N of ${short(compile.largest_N)} N.`,
      );
    this.plots.hidden = !lines.length;
    if (!lines.length) return [make("p", { className: "empty", textContent: HINT })];
    const found = lines.map((text) => make("p", { className: "soft", textContent: text }));
    return identify ? [misfits(identify), ...found] : found;
  }

  draw() {
    if (!this.now || this.plots.hidden) return;
    const { clientWidth, clientHeight } = this.left.canvas.parentElement;
    const key = `${clientWidth} ${clientHeight} ${document.documentElement.dataset.theme}`;
    if (key === this.#shown) return;
    this.#shown = key;
    const { measure, identify } = this.#results;
    if (!identify) return this.#drawDrive(measure.played);
    const { loops } = identify;
    this.#drawErrors(loops);
    const all = (name) => loops.map((one) => one[name]);
    this.loops.begin([...limits(...all("current")), ...limits(...all("force"), ...all("old"))]);
    for (const one of loops) this.loops.line(one.current, one.force, ink("--soft"), 2.5, 0.5);
    for (const one of loops) this.loops.line(one.current, one.old, OLD_MODEL_COLOUR, 1);
    for (const one of loops) this.loops.line(one.current, one.new, NEW_MODEL_COLOUR, 1);
  }

  #drawDrive({ time, current }) {
    this.left.labels = ["time / s", "current / A"];
    this.left.begin([...limits(time), ...limits(current)]);
    this.left.line(time, current, NEW_MODEL_COLOUR, 1);
  }

  // Draws the error of each model against the measured loops.
  #drawErrors(loops) {
    const errors = (name) =>
      loops.map((one) => one[name].map((force, i) => force - one.force[i]));
    const [old, found] = [errors("old"), errors("new")];
    this.left.labels = ["current / A", "model − measured / N"];
    this.left.begin([...limits(...loops.map((one) => one.current)), ...limits(...old, ...found)]);
    for (const [n, { current }] of loops.entries()) {
      this.left.line(current, old[n], OLD_MODEL_COLOUR, 1);
      this.left.line(current, found[n], NEW_MODEL_COLOUR, 1);
    }
  }
}

// Returns a table of the residuals of both models, over all loops and for each gap.
function misfits({ law, old, new: found, gaps }) {
  const cell = (text, colour) => {
    const element = make("td", { textContent: text });
    if (colour) element.style.color = colour;
    return element;
  };
  const row = (name, one, other) =>
    make(
      "tr",
      {},
      make("th", { textContent: name, scope: "row" }),
      cell(`${short(one.rms_N)} N`, OLD_MODEL_COLOUR),
      cell(`${short(one.worst_N)} N`, OLD_MODEL_COLOUR),
      cell(`${short(other.rms_N)} N`, NEW_MODEL_COLOUR),
      cell(`${short(other.worst_N)} N`, NEW_MODEL_COLOUR),
    );
  const heads = ["Against measured loops", "Old: rms", "Worst", `New (${law}): rms`, "Worst"];
  return make(
    "table",
    { id: "misfits" },
    make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { textContent: text })))),
    make(
      "tbody",
      {},
      row("all", old, found),
      ...(gaps.length > 1
        ? gaps.map((one) => row(`${short(1e3 * one.gap_m)} mm`, one.old, one.new))
        : []),
    ),
  );
}

function short(value) {
  return String(Number(value.toPrecision(4)));
}
