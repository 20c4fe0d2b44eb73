// Controls of the recorder: file, start and end. Shows the running recording.

import { field, make, select } from "./dom.js";
import { downloadList } from "./library.js";
import { signalChoice, signalOf } from "./signals.js";
import { shown } from "./units.js";

const KINDS = [
  [".mf4", "MDF (.mf4)"],
  [".csv", "CSV"],
];
const EDGES = [
  ["", "immediately"],
  ["rising", "↗"],
  ["falling", "↘"],
];

export class RecorderPanel {
  constructor(place, bench, order) {
    this.bench = bench;
    this.order = order;
    const number = (id, value, hint) => {
      const input = make("input", { type: "number", step: "any", id, value, className: "number" });
      input.setAttribute("aria-label", hint);
      return input;
    };
    this.name = make("input", { id: "record-name", value: bench.choices.get("record", "run"), size: 9 });
    this.name.setAttribute("aria-label", "name of the recording");
    this.kind = select(KINDS, bench.choices.get("record kind", ".mf4"));
    this.kind.id = "record-kind";
    this.before = number("record-before", 0, "seconds before");
    this.lasts = number("record-lasts", "", "seconds it lasts");
    this.lasts.placeholder = "until stop";
    this.edge = select(EDGES, "");
    this.edge.id = "record-edge";
    this.signal = signalChoice(bench, bench.aim.signal, "signal of the start", { id: "record-signal" });
    this.kind.ariaLabel = "format of the file";
    this.edge.ariaLabel = "start of the recording";
    this.level = number("record-level", 0, "level of the trigger");
    this.unit = make("span", { className: "unit" });
    this.crossing = make("div", { className: "line" }, this.signal, this.level, this.unit);
    this.edge.onchange = this.signal.onchange = () => this.#refresh();
    const button = (id, textContent, title, onclick) => make("button", { id, textContent, title, onclick });
    this.finished = downloadList(bench);
    this.now = make("output", { className: "reading", id: "recorded" });
    const line = (...children) => make("div", { className: "line" }, ...children);
    const options = make(
      "details",
      {},
      make("summary", { textContent: "Start and end" }),
      line(field("from", this.before, "s before"), this.edge),
      this.crossing,
      line(field("lasts", this.lasts, "s")),
    );
    place.append(
      line(this.name, this.kind),
      options,
      line(
        (this.startButton = button("record", "Record", "Write every tick to a new file", () => this.start())),
        (this.stopButton = button("record-stop", "Stop recording", "End the recording", () => order("record", { file: null }))),
        button("keep", `Keep last ${bench.kept} s`, `Write the last ${bench.kept} s to a new file`, () => this.keep()),
      ),
      this.now,
      this.finished.element,
    );
    this.#refresh();
  }

  #refresh() {
    this.crossing.hidden = !this.edge.value;
    this.unit.textContent = this.#shown().name;
  }

  #shown() {
    return shown(signalOf(this.bench, this.signal.value)?.unit ?? "");
  }

  start() {
    const lasts = this.lasts.value === "" ? null : Number(this.lasts.value);
    const fields = { before: Number(this.before.value), lasts };
    if (this.edge.value) {
      fields.signal = this.signal.value;
      fields.rising = this.edge.value === "rising";
      fields.level = Number(this.level.value) / this.#shown().factor;
    }
    return this.#send(fields);
  }

  keep() {
    return this.#send({ before: this.bench.kept, lasts: 0 });
  }

  async #send(fields) {
    const name = this.name.value.trim();
    this.bench.choices.set("record kind", this.kind.value);
    const answer = await this.order("record", { file: `${name}${this.kind.value}`, ...fields });
    if (!answer) return;
    this.name.value = following(name);
    this.bench.choices.set("record", this.name.value);
  }

  status({ recording, log }) {
    const told = log.findLast(({ who }) => who === "recorder")?.text;
    if (told) this.result = told.includes(" written, ") ? `${told}, in ${this.bench.folder}` : told;
    this.startButton.hidden = Boolean(recording);
    this.stopButton.hidden = !recording;
    this.now.textContent = recording
      ? `${recording.file}: ${recording.waits ? "waits for the trigger" : `${recording.rows} ticks`}`
      : (this.result ?? "Nothing is recorded.");
  }
}

// Returns the next file name: run, run-2, run-3.
function following(name) {
  const parts = /^(.*?)(?:-(\d+))?$/.exec(name);
  return `${parts[1]}-${Number(parts[2] ?? 1) + 1}`;
}
