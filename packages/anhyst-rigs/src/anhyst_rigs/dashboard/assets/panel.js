// Controls: states and commands, target, recorder, generator, load drive or armature, speed.

import { NAME as COMPENSATION, compensationSwitch } from "./compensation.js";
import { field, make, refuse, select } from "./dom.js";
import { GeneratorPanel } from "./generator.js";
import { Quantity } from "./quantity.js";
import { RecorderPanel } from "./recorder.js";
import { StateBar } from "./statebar.js";
import { show, shown, usual } from "./units.js";

const SPEEDS = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
const SLIDER_MS = 50; // delay of a slider's order, which a further movement restarts

export class Panel {
  constructor(place, bench, order, parameters) {
    this.bench = bench;
    this.order = order;
    this.unit = bench.aim.unit;
    this.gap = bench.parameters.find((one) => one.name === "gap");
    this.pushes = bench.parameters.filter((one) => one.name.startsWith("push_"));
    this.states = new StateBar(bench, order);
    const recorder = this.#group("Recorder", "record");
    const generator = this.#group("Generator", "generator");
    this.recorder = new RecorderPanel(recorder, bench, order);
    this.generator = new GeneratorPanel(generator, bench, order);
    // A foreign firmware has no commands and no target.
    const operated = (group) => Object.assign(group, { hidden: !bench.commands.length });
    place.replaceChildren(
      operated(this.#group("State", "", this.states.element)),
      operated(this.#group("Target", "target", ...this.#target())),
      ...(parameters.value(COMPENSATION) === undefined
        ? []
        : [this.#group("Compensation", "apply", compensationSwitch(parameters))]),
      recorder,
      operated(generator),
      ...(bench.load_most ? [this.#group("Load drive", "load", ...this.#load())] : []),
      ...(this.pushes.length ? [this.#group("Push", "apply", ...this.#push())] : []),
      ...(this.gap ? [this.#group("Armature", "apply", ...this.#armature())] : []),
      ...(bench.keeps_time ? [] : [this.#group("Time", "pace", ...this.#time())]),
    );
    const senders = place.querySelectorAll("fieldset:not([data-order='']) :is(button, [type=range], #speed)");
    this.senders = [...senders];
  }

  // Returns a group of controls, which names the order that they send.
  #group(title, order, ...children) {
    const group = make("fieldset", {}, make("legend", { textContent: title }), ...children);
    group.dataset.order = order;
    return group;
  }

  #target() {
    const { aim } = this.bench;
    const go = () => this.target.check() && this.order("target", { value: this.target.value });
    this.target = new Quantity({ ...aim, id: "target", label: "target", value: undefined }, undefined, go);
    const range = aim.high - aim.low;
    const height = this.bench.choices.get("step SI", usual(aim, 0.1) / shown(aim.unit).factor);
    this.step = new Quantity({ unit: aim.unit, low: -range, high: range, id: "step", label: "height of a step", value: height });
    const step = (way) => {
      const from = this.target.check() ? this.target.value : this.activeTarget;
      if (!this.step.check() || typeof from !== "number") return;
      this.bench.choices.set("step SI", this.step.value);
      this.target.set(from + way * this.step.value);
      go();
    };
    this.targetNow = make("output", { className: "reading" });
    const button = (id, textContent, title, onclick) => make("button", { id, textContent, title, onclick });
    const line = (...children) => make("div", { className: "line" }, ...children);
    this.go = button("go", "Set", "Set this target (Enter)", go);
    return [
      line(...this.target.elements, this.go, this.targetNow),
      this.target.message,
      this.target.slider(),
      line(
        button("step-down", "− Step", "Lower the target by this height", () => step(-1)),
        button("step-up", "+ Step", "Raise the target by this height", () => step(1)),
        ...this.step.elements,
      ),
      this.step.message,
    ];
  }

  #load() {
    const most = this.bench.load_most;
    this.load = this.#quantity({ id: "load", label: "load force", unit: "N", low: -most, high: most, value: 0 }, (value) =>
      this.order("load", { value }),
    );
    this.loadNow = make("output", { className: "reading" });
    return [...this.load.lines, this.loadNow];
  }

  // Returns controls for a push by the magnets along one coordinate; it is zero along the others.
  #push() {
    const names = this.pushes.map(({ name }) => name);
    const axis = select(names.map((name) => [name, name.replace("push_", "along ")]), names[0]);
    Object.assign(axis, { id: "push-axis", ariaLabel: "axis of the push" });
    const now = make("output", { className: "reading" });
    const order = (part) => {
      const { name, high, unit } = this.pushes.find((one) => one.name === axis.value);
      now.textContent = show(part * high, unit, 3);
      this.order("apply", { values: { ...Object.fromEntries(names.map((one) => [one, 0])), [name]: part * high } });
    };
    const slider = this.#slider({ id: "push", min: -1, max: 1, step: 0.05, value: 0, ariaLabel: "push" }, order);
    axis.onchange = () => slider.oninput();
    return [make("div", { className: "line" }, axis, now), make("div", { className: "line" }, slider)];
  }

  #armature() {
    const order = (gap) => this.order("apply", { values: { gap } });
    this.place = this.#quantity({ ...this.gap, id: "gap", label: "gap of the armature" }, order);
    this.gapNow = make("output", { className: "reading" });
    return [...this.place.lines, this.gapNow];
  }

  // Returns a field with a slider that sends its order when it has not moved for SLIDER_MS.
  #quantity(spec, order) {
    let due = 0;
    const later = () => {
      clearTimeout(due);
      due = setTimeout(() => order(quantity.value), SLIDER_MS);
    };
    const quantity = new Quantity(spec, later, order);
    const slider = quantity.slider();
    slider.id = `${spec.id}-slider`;
    return Object.assign(quantity, { lines: [make("div", { className: "line" }, ...quantity.elements), quantity.message, slider] });
  }

  // Returns a slider that sends its order when it has not moved for SLIDER_MS.
  #slider(properties, order) {
    const slider = make("input", { type: "range", ...properties });
    let due = 0;
    slider.oninput = () => {
      clearTimeout(due);
      due = setTimeout(() => order(Number(slider.value)), SLIDER_MS);
    };
    return slider;
  }

  #time() {
    const speed = select(
      SPEEDS.map((one) => [String(one), `${one} ×`]),
      "1",
    );
    speed.id = "speed";
    speed.onchange = () => this.order("pace", { speed: Number(speed.value) });
    this.pause = make("button", { textContent: "Pause", id: "pause", title: "Pause the time of the rig" });
    this.pause.onclick = () => this.order("pace", { paused: !this.paused });
    const single = make("button", { textContent: "1 tick", id: "single", title: "Pause, and advance by one tick" });
    single.onclick = () => this.order("pace", { paused: true, steps: 1 });
    this.speed = speed;
    return [make("div", { className: "line" }, field("Speed", speed), this.pause, single)];
  }

  // Shows the status of the bench; a field that is being edited is not changed.
  status(status, values) {
    for (const one of this.senders)
      refuse(one, status.refused[one.closest("[data-order]").dataset.order]);
    this.states.status(status);
    this.go.classList.toggle("primary", this.bench.states[status.state] === "run");
    this.recorder.status(status);
    this.generator.status(status);
    this.#showTarget(status.target);
    if (this.load) {
      const load = status.load ?? values.load;
      this.loadNow.textContent = `commanded ${show(load, "N")}`;
      if (load !== undefined) this.#follow(this.load, load);
    }
    if (this.gap) this.gapNow.textContent = `gap ${show(values.gap, "m", 4)}`;
    if (this.bench.keeps_time) return;
    this.paused = status.paused;
    this.pause.textContent = status.paused ? "Continue" : "Pause";
    if (document.activeElement !== this.speed) this.speed.value = String(status.speed);
  }

  // Shows the present target. After a change, the field and the slider show it too, unless the user is changing them
  // or the controller does not accept it; at first, they show a target that it accepts.
  #showTarget(target) {
    this.targetNow.textContent = `now ${show(target, this.unit)}`;
    if (target === null || target === this.activeTarget) return;
    this.activeTarget = target;
    const { aim } = this.bench;
    const accepted = target >= aim.low && target <= aim.high && target !== 0;
    if (this.target.input.value === "") this.target.set(accepted || aim.low < 0 ? target : aim.low + usual(aim, 0.25) / shown(aim.unit).factor);
    else if (accepted && !this.target.isBusy()) this.target.set(target);
  }

  // Moves a field and its slider to a value that another browser has set, unless the user is editing them.
  #follow(quantity, value) {
    if (!quantity.isBusy() && quantity.value !== value) quantity.set(value);
  }
}
