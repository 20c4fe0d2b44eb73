// Controls: commands, target, generator, load drive, speed.

import { field, kept, make, select } from "./dom.js";
import { show, shown } from "./units.js";

const SPEEDS = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
const LOAD_STEP_MS = 50; // between two orders of a slider that moves

export class Panel {
  constructor(place, bench, order) {
    this.bench = bench;
    this.order = order;
    const followed = bench.signals.find((signal) => signal.name === "gap") ?? { unit: "N" };
    this.unit = followed.unit;
    this.shown = shown(this.unit);
    place.replaceChildren(
      this.#group("Commands", this.#commands()),
      this.#group("Target", ...this.#target()),
      this.#group("Generator", ...this.#generator()),
      this.#group("Load drive", ...this.#load()),
      this.#group("Time", ...this.#time()),
    );
  }

  #group(title, ...children) {
    return make("fieldset", {}, make("legend", { textContent: title }), ...children);
  }

  #commands() {
    const row = make("div", { className: "commands" });
    for (const name of this.bench.commands) {
      row.append(
        make("button", { textContent: name, onclick: () => this.order("command", { name }) }),
      );
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
    const [height, heightUnit] = this.#number("step", kept.get("step", 20), this.shown.name);
    const go = () => this.order("target", { value: Number(value.value) / this.shown.factor });
    this.target = value;
    const step = (way) => {
      kept.set("step", Number(height.value));
      value.value = Number((Number(value.value) + way * Number(height.value)).toPrecision(10));
      go();
    };
    value.onkeydown = (event) => event.key === "Enter" && go();
    this.targetNow = make("output", { className: "reading" });
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

  #generator() {
    const shape = select(
      this.bench.shapes.map((name) => [name, name]),
      "step",
    );
    shape.id = "shape";
    const [amplitude, unit] = this.#number("amplitude", 10, this.shown.name);
    const [frequency] = this.#number("frequency", 2, "");
    const start = () =>
      this.order("generator", {
        shape: shape.value,
        amplitude: Number(amplitude.value) / this.shown.factor,
        frequency: Number(frequency.value),
      });
    const stop = () => this.order("generator", { shape: null });
    this.generatorNow = make("output", { className: "reading" });
    return [
      make("div", { className: "line" }, shape, field("±", amplitude, unit)),
      make("div", { className: "line" }, field("at", frequency, "Hz")),
      make(
        "div",
        { className: "line" },
        make("button", { textContent: "start", id: "generate", onclick: start }),
        make("button", { textContent: "off", id: "generate-off", onclick: stop }),
        this.generatorNow,
      ),
    ];
  }

  #load() {
    const slider = make("input", {
      type: "range",
      min: -300,
      max: 300,
      step: 1,
      value: 0,
      id: "load",
    });
    this.loadNow = make("output", { className: "reading" });
    let due = 0;
    slider.oninput = () => {
      clearTimeout(due);
      due = setTimeout(() => this.order("load", { value: Number(slider.value) }), LOAD_STEP_MS);
    };
    this.load = slider;
    return [make("div", { className: "line" }, slider), this.loadNow];
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

  // Shows what the bench says; fields in which somebody types are left alone.
  status(status, values) {
    const { target } = status;
    this.targetNow.textContent = `now ${show(target, this.unit)}`;
    if (this.target.value === "" && target !== null)
      this.target.value = Number((target * this.shown.factor).toPrecision(6));
    const { generator } = status;
    this.generatorNow.textContent = generator
      ? `${generator.shape} ± ${show(generator.amplitude, this.unit)}, ${generator.frequency} Hz`
      : "off";
    const load = status.load ?? values.load;
    this.loadNow.textContent = `commanded ${show(load, "N")}`;
    if (document.activeElement !== this.load && load !== undefined) this.load.value = load;
    this.paused = status.paused;
    this.pause.textContent = status.paused ? "go on" : "pause bench";
    if (document.activeElement !== this.speed) this.speed.value = String(status.speed);
  }
}
