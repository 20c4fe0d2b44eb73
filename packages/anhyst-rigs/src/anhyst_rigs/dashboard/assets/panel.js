// Controls: commands, target, generator, load drive or armature, speed.

import { NAME as COMPENSATION, compensationSwitch } from "./compensation.js";
import { field, make, refuse, select } from "./dom.js";
import { GeneratorPanel } from "./generator.js";
import { RecorderPanel } from "./recorder.js";
import { show, shown, usual } from "./units.js";

const SPEEDS = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
const SLIDER_MS = 50; // delay of a slider's order, which a further movement restarts

export class Panel {
  constructor(place, bench, order, parameters) {
    this.bench = bench;
    this.order = order;
    this.unit = bench.aim.unit;
    this.shown = shown(this.unit);
    this.gap = bench.parameters.find((one) => one.name === "gap");
    this.pushes = bench.parameters.filter((one) => one.name.startsWith("push_"));
    const generator = this.#group("Generator", "generator");
    this.generator = new GeneratorPanel(generator, bench, order);
    place.replaceChildren(
      this.#group("Commands", "", this.#commands()),
      this.#group("Target", "target", ...this.#target()),
      ...(parameters.value(COMPENSATION) === undefined
        ? []
        : [this.#group("Compensation", "apply", compensationSwitch(parameters))]),
      generator,
      ...(bench.load_most ? [this.#group("Load drive", "load", ...this.#load())] : []),
      ...(this.pushes.length ? [this.#group("Push", "apply", ...this.#push())] : []),
      ...(this.gap ? [this.#group("Armature", "apply", ...this.#armature())] : []),
      ...(bench.keeps_time ? [] : [this.#group("Time", "pace", ...this.#time())]),
    );
    const recorder = this.#group("Recorder", "record");
    this.recorder = new RecorderPanel(recorder, bench, order);
    place.append(recorder);
    this.senders = [...place.querySelectorAll("button, [type=range], #speed")];
  }

  // Returns a group of controls. The group names the order that they send; a command button names its command.
  #group(title, order, ...children) {
    const group = make("fieldset", {}, make("legend", { textContent: title }), ...children);
    group.dataset.order = order;
    return group;
  }

  #commands() {
    const row = make("div", { className: "commands" });
    for (const name of this.bench.commands) {
      const button = make("button", { textContent: name });
      button.onclick = () => this.order("command", { name });
      button.dataset.order = name;
      row.append(button);
    }
    return row;
  }

  #number(id, value, unit) {
    const input = make("input", { type: "number", step: "any", id, value, className: "number" });
    input.setAttribute("aria-label", id);
    return [input, make("span", { className: "unit", textContent: unit })];
  }

  #target() {
    const [value, unit] = this.#number("target", "", this.shown.name);
    const [height, heightUnit] = this.#number(
      "step",
      this.bench.choices.get("step", usual(this.bench.aim, 0.1)),
      this.shown.name,
    );
    const go = () => this.order("target", { value: Number(value.value) / this.shown.factor });
    this.target = value;
    const step = (way) => {
      this.bench.choices.set("step", Number(height.value));
      value.value = Number((Number(value.value) + way * Number(height.value)).toPrecision(10));
      go();
    };
    value.onkeydown = (event) => event.key === "Enter" && go();
    this.targetNow = make("output", { className: "reading" });
    const { low, high } = this.bench.aim;
    value.title = `${show(low, this.unit)} to ${show(high, this.unit)}`;
    return [
      make(
        "div",
        { className: "line" },
        value,
        unit,
        make("button", { textContent: "go", id: "go", onclick: go }),
        this.targetNow,
      ),
      make(
        "div",
        { className: "line" },
        make("button", { textContent: "− step", id: "step-down", onclick: () => step(-1) }),
        make("button", { textContent: "+ step", id: "step-up", onclick: () => step(1) }),
        height,
        heightUnit,
      ),
    ];
  }

  #load() {
    const most = this.bench.load_most;
    const order = (value) => this.order("load", { value });
    this.load = this.#slider({ id: "load", min: -most, max: most, step: 1, value: 0 }, order);
    this.loadNow = make("output", { className: "reading" });
    return [make("div", { className: "line" }, this.load), this.loadNow];
  }

  // Returns controls for a push by the magnets along one coordinate; it is zero along the others.
  #push() {
    const names = this.pushes.map(({ name }) => name);
    const axis = select(names.map((name) => [name, name.replace("push_", "along ")]), names[0]);
    axis.id = "push-axis";
    const now = make("output", { className: "reading" });
    const order = (part) => {
      const { name, high, unit } = this.pushes.find((one) => one.name === axis.value);
      now.textContent = show(part * high, unit, 3);
      this.order("apply", { values: { ...Object.fromEntries(names.map((one) => [one, 0])), [name]: part * high } });
    };
    const slider = this.#slider({ id: "push", min: -1, max: 1, step: 0.05, value: 0 }, order);
    axis.onchange = () => slider.oninput();
    return [make("div", { className: "line" }, axis, now), make("div", { className: "line" }, slider)];
  }

  #armature() {
    const { low, high, value } = this.gap;
    const factor = shown("m").factor;
    const order = (micrometres) => this.order("apply", { values: { gap: micrometres / factor } });
    this.place = this.#slider(
      { id: "gap", min: low * factor, max: high * factor, step: 1, value: value * factor },
      order,
    );
    this.gapNow = make("output", { className: "reading" });
    return [make("div", { className: "line" }, this.place), this.gapNow];
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
    this.pause = make("button", { textContent: "pause bench", id: "pause" });
    this.pause.onclick = () => this.order("pace", { paused: !this.paused });
    const single = make("button", { textContent: "1 tick", id: "single" });
    single.onclick = () => this.order("pace", { paused: true, steps: 1 });
    this.speed = speed;
    return [make("div", { className: "line" }, field("speed", speed), this.pause, single)];
  }

  // Shows the status of the bench; a field that is being edited is not changed.
  status(status, values) {
    for (const one of this.senders)
      refuse(one, status.refused[one.closest("[data-order]").dataset.order]);
    this.recorder.status(status);
    this.generator.status(status);
    const { target } = status;
    this.targetNow.textContent = `now ${show(target, this.unit)}`;
    if (this.target.value === "" && target !== null)
      this.target.value = Number((target * this.shown.factor).toPrecision(6));
    if (this.load) {
      const load = status.load ?? values.load;
      this.loadNow.textContent = `commanded ${show(load, "N")}`;
      if (document.activeElement !== this.load && load !== undefined) this.load.value = load;
    }
    if (this.gap) this.gapNow.textContent = `gap ${show(values.gap, "m", 4)}`;
    if (this.bench.keeps_time) return;
    this.paused = status.paused;
    this.pause.textContent = status.paused ? "go on" : "pause bench";
    if (document.activeElement !== this.speed) this.speed.value = String(status.speed);
  }
}
