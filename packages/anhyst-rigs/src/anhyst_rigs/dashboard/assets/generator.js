// Controls of the signal generator: a shape, a sweep or a user's table is added to the target.

import { field, make, select } from "./dom.js";
import { aimName } from "./names.js";
import { Quantity } from "./quantity.js";
import { seconds, show, shown, usual } from "./units.js";

const CHIRP = "chirp";
const TABLE = "own CSV";
const MAX_TABLE_BYTES = 12000; // largest size of a table in bytes, so that it fits into a message

export class GeneratorPanel {
  constructor(place, bench, order) {
    this.order = order;
    this.unit = bench.aim.unit;
    this.shown = shown(this.unit);
    const line = (...children) => make("div", { className: "line" }, ...children);
    const number = (id, value) => {
      const input = make("input", { type: "number", step: "any", id, value, className: "number" });
      input.setAttribute("aria-label", id);
      return input;
    };
    this.shape = select(
      [...bench.shapes, CHIRP, TABLE].map((name) => [name, name]),
      "step",
    );
    this.shape.id = "shape";
    this.shape.ariaLabel = "shape of the signal";
    const { aim } = bench;
    const most = 0.5 * (aim.high - aim.low);
    const amplitude = usual(aim, 0.05) / this.shown.factor;
    this.amplitude = new Quantity({ unit: this.unit, low: 0, high: most, id: "amplitude", label: "amplitude", value: amplitude });
    const [low, high] = bench.frequencies;
    const frequency = (id, value) => new Quantity({ unit: "Hz", low, high, id, label: id, value });
    this.frequency = frequency("frequency", 2);
    this.low = frequency("chirp-low", 0.5);
    this.high = frequency("chirp-high", 50);
    this.lasts = number("chirp-lasts", 20);
    this.file = make("input", { ariaLabel: "CSV of the signal", type: "file", accept: ".csv,text/csv", id: "table" });
    const checked = (text, { elements, message }) => make("div", {}, line(make("span", { className: "unit", textContent: text }), ...elements), message);
    this.lines = {
      amplitude: checked("±", this.amplitude),
      frequency: checked("at", this.frequency),
      chirp: make("div", {}, checked("from", this.low), checked("to", this.high), line(field("in", this.lasts, "s"))),
      table: line(this.file),
    };
    this.lines.table.title = `header t_s,${this.unit === "m" ? "gap_um" : "F_N"}, then rows; added to the ${aimName(bench).toLowerCase()}`;
    this.now = make("output", { className: "reading" });
    const button = (id, textContent, onclick) => make("button", { id, textContent, onclick });
    place.append(
      make("div", { className: "line" }, this.shape, ...Object.values(this.lines)),
      line(
        button("generate", "Start", () => this.start()),
        button("generate-off", "Off", () => order("generator", { shape: null })),
        this.now,
      ),
    );
    this.shape.onchange = () => this.#refresh();
    this.#refresh();
  }

  #refresh() {
    const { value } = this.shape;
    this.lines.amplitude.hidden = value === TABLE;
    this.lines.frequency.hidden = value === TABLE || value === CHIRP;
    this.lines.chirp.hidden = value !== CHIRP;
    this.lines.table.hidden = value !== TABLE;
  }

  async start() {
    const shape = this.shape.value;
    if (shape === TABLE) return this.#startTable();
    const used = shape === CHIRP ? { amplitude: this.amplitude, low: this.low, high: this.high } : { amplitude: this.amplitude, frequency: this.frequency };
    const wrong = Object.values(used).find(({ value }) => value === null);
    if (wrong) return wrong.input.focus();
    const values = Object.fromEntries(Object.entries(used).map(([name, { value }]) => [name, value]));
    return this.order("generator", { shape, ...values, ...(shape === CHIRP ? { lasts: Number(this.lasts.value) } : {}) });
  }

  async #startTable() {
    const [file] = this.file.files;
    if (!file || file.size > MAX_TABLE_BYTES) {
      this.now.textContent = file ? `larger than ${MAX_TABLE_BYTES} bytes` : "choose a file";
      return null;
    }
    return this.order("generator", { shape: TABLE, text: await file.text() });
  }

  status({ generator }) {
    const key = JSON.stringify(generator);
    if (this.key === key) return;
    this.key = key;
    this.now.textContent = generator ? this.#describe(generator) : "off";
  }

  #describe({ shape, amplitude, frequency, low, high, lasts, rows }) {
    if (shape === TABLE) return `${rows} rows, ${seconds(lasts)}`;
    const size = `± ${show(amplitude, this.unit)}`;
    if (shape === CHIRP) return `${size}, ${low} to ${high} Hz in ${seconds(lasts)}`;
    return `${shape} ${size}, ${frequency} Hz`;
  }
}
