// Controls of the trigger: mode, signal, edge, level, and the part of the window before the crossing.

import { field, make, select } from "./dom.js";
import { signalChoice, signalOf } from "./signals.js";
import { shown } from "./units.js";

const MODES = [
  ["off", "Off"],
  ["auto", "Auto"],
  ["normal", "Normal"],
  ["single", "Single"],
];
const EDGES = [
  ["rising", "↗"],
  ["falling", "↘"],
];

export class TriggerControls {
  #levels = new Map(); // levels that the user has set, by signal

  // `arm` receives the settings of the trigger, or null if it is off; `middle` returns the mean of a column over the
  // window, and whether it is constant.
  constructor(bench, arm, middle) {
    this.middle = middle;
    this.bench = bench;
    this.arm = arm;
    const number = (id, value) => make("input", { type: "number", step: "any", id, value, className: "number" });
    this.mode = select(MODES, "off");
    this.mode.id = "trigger-mode";
    this.signal = signalChoice(bench, bench.aim.signal, "signal of the trigger", { id: "trigger-signal" });
    this.edge = select(EDGES, "rising");
    this.edge.id = "trigger-edge";
    this.edge.ariaLabel = "edge of the trigger";
    this.level = number("trigger-level", 0);
    this.pre = number("trigger-pre", 20);
    this.unit = make("span", { className: "unit" });
    this.waits = make("output", { className: "reading", textContent: "not triggered" });
    const details = [this.signal, this.edge, field("at", this.level, this.unit), field("before", this.pre, "%"), this.waits];
    this.details = make("span", { className: "line" }, ...details);
    this.elements = [field("Trigger", this.mode), this.details];
    for (const one of [this.mode, this.signal, this.edge, this.level, this.pre]) one.onchange = () => this.#change();
    this.level.addEventListener("input", () => this.#levels.set(this.signal.value, this.level.value));
    this.#show();
  }

  // Switches the trigger off if its signal was deleted.
  check() {
    if (signalOf(this.bench, this.signal.value)) return;
    this.signal.choose(this.bench.aim.signal);
    this.mode.value = "off";
    this.#change();
  }

  // Shows whether the trigger waits for a crossing. The text always has its place, so that nothing moves.
  wait(waits) {
    this.waits.style.visibility = waits ? "visible" : "hidden";
  }

  #show() {
    this.details.hidden = this.mode.value === "off";
    this.unit.textContent = shown(this.#signal().unit).name;
  }

  #signal() {
    return signalOf(this.bench, this.signal.value);
  }

  // Shows the level that the user has set for the signal, otherwise the mean of the signal. A constant signal never
  // crosses its mean, so the level is next to it.
  #propose() {
    const { column, name, unit } = this.#signal();
    const { factor, least } = shown(unit);
    const { mean, isConstant } = this.middle(column);
    const away = isConstant ? (this.edge.value === "rising" ? least : -least) : 0;
    this.level.value = this.#levels.get(name) || Number((mean * factor + away).toPrecision(5));
  }

  #change() {
    this.#show();
    if (this.mode.value !== "off") this.#propose();
    const { name, unit } = this.#signal();
    const settings = {
      name,
      level: Number(this.level.value) / shown(unit).factor,
      rising: this.edge.value === "rising",
      pre: Math.min(1, Math.max(0, Number(this.pre.value) / 100)),
      mode: this.mode.value,
    };
    this.arm(settings.mode === "off" ? null : settings);
  }
}
