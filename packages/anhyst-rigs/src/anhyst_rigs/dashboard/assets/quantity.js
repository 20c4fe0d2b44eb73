// A number with a unit: "0.2 mm", "200 um" and "200" are the same if the field shows micrometres.

import { NAME as COMPENSATION } from "./compensation.js";
import { make } from "./dom.js";
import { isUsual, shown } from "./units.js";

const PREFIXES = { G: 1e9, M: 1e6, k: 1e3, "": 1, m: 1e-3, "µ": 1e-6, n: 1e-9, p: 1e-12 };
const COARSE = 0.01; // step of the arrow keys, as a fraction of the range; Shift makes it ten times smaller
const SLIDER_STEPS = 1000; // number of positions of a slider

// Returns the unit in which a quantity is shown: the usual unit of signals, or a prefix that suits its size.
export function unitFor({ unit, low, high, value = 0 }) {
  const size = Math.abs(value) || 0.1 * Math.max(Math.abs(low), Math.abs(high));
  if (!unit || isUsual(unit) || !(size > 0)) return shown(unit);
  const [prefix, part] = Object.entries(PREFIXES).find(([, part]) => size >= part) ?? ["p", 1e-12];
  return { name: prefix + unit, factor: 1 / part };
}

// Returns the value of a parameter with its unit.
export function showParameter(one) {
  if (one.name === COMPENSATION) return one.value ? "on" : "off";
  const { name, factor } = unitFor(one);
  return `${Number((one.value * factor).toPrecision(5))}${name && ` ${name}`}`;
}

// Returns the SI value of a text; throws an error with the remedy. A number without a unit has the shown unit.
export function parse(text, unit, display) {
  const found = /^([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?)\s*(.*)$/i.exec(text.trim().replace("−", "-"));
  const example = `such as 0.2 ${display.name || ""}`.trim();
  if (!found) throw new Error(`Enter a number, ${example}.`);
  const number = Number(found[1].replace(",", "."));
  const given = plain(found[2]);
  if (!given || given === plain(display.name)) return number / display.factor;
  for (const [prefix, part] of Object.entries(PREFIXES)) {
    if (unit && given === plain(prefix + unit)) return number * part;
  }
  if (given === "%" && !unit) return number / 100;
  throw new Error(`"${found[2]}" is not a unit of this quantity; enter a number, ${example}.`);
}

// Returns a unit in the form in which units are compared.
const plain = (unit) => unit.replace(/μ|^u(?=[a-zA-Z])/g, "µ").replace(/[\s_·*]+/g, " ").trim();

export class Quantity {
  // `spec`: id, label, unit (SI), low, high, value; `changed` receives valid values in SI units, `sent` those
  // that the user confirms with Enter.
  constructor(spec, changed = () => {}, sent = () => {}) {
    this.spec = spec;
    this.display = unitFor(spec);
    this.changed = changed;
    this.input = make("input", { type: "text", inputMode: "decimal", className: "number", id: spec.id ?? "" });
    this.input.setAttribute("aria-label", spec.label);
    this.input.title = `${this.range()}. A unit is possible, such as 0.2 ${this.display.name || ""}`.trim();
    this.message = make("output", { className: "invalid", hidden: true });
    this.unit = make("span", { className: "unit", textContent: this.display.name });
    this.input.oninput = () => this.check() && this.changed(this.value);
    this.input.onkeydown = (event) => this.#key(event, sent);
    this.elements = [this.input, this.unit];
    if (spec.value !== undefined) this.set(spec.value);
  }

  // Value in SI units; null if the text is not valid.
  get value() {
    try {
      const value = parse(this.input.value, this.spec.unit, this.display);
      return this.#outside(value) ? null : value;
    } catch {
      return null;
    }
  }

  // Whether a value is outside the range by more than the rounding of the shown digits.
  #outside(value) {
    const { low, high } = this.spec;
    const slack = 1e-6 * Math.max(Math.abs(low), Math.abs(high));
    return value < low - slack || value > high + slack;
  }

  // Returns the range in words, rounded to values within it.
  range() {
    const { factor, name } = this.display;
    const inward = (value, round, slack) => {
      const size = 10 ** (3 - Math.floor(Math.log10(Math.abs(value * factor) || 1)));
      return Number((round(value * factor * size + slack) / size).toPrecision(6));
    };
    return `${inward(this.spec.low, Math.ceil, -1e-6)} to ${inward(this.spec.high, Math.floor, 1e-6)}${name && ` ${name}`}`;
  }

  text(value) {
    return String(Number((value * this.display.factor).toPrecision(6)));
  }

  // Shows a value in the field and at its slider.
  set(value) {
    this.input.value = this.text(value);
    this.check();
    this.follow?.();
  }

  // Shows what is wrong with the text; returns whether it is valid.
  check() {
    let wrong = "";
    try {
      const value = parse(this.input.value, this.spec.unit, this.display);
      if (this.#outside(value)) wrong = `Choose ${this.range()}.`;
    } catch (error) {
      wrong = error.message;
    }
    this.message.textContent = wrong;
    this.message.hidden = !wrong;
    this.input.setAttribute("aria-invalid", String(Boolean(wrong)));
    return !wrong;
  }

  #key(event, sent) {
    if (event.key === "Enter" && this.check()) sent(this.value, event);
    const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    const { low, high } = this.spec;
    if (!way || this.value === null) return;
    event.preventDefault();
    const step = COARSE * (high - low) * (event.shiftKey ? 0.1 : 1);
    this.set(Math.min(high, Math.max(low, this.value + way * step)));
    this.changed(this.value);
  }

  // Returns a slider over the range that moves with the field; Shift and an arrow key move it finely.
  slider() {
    const { low, high, label } = this.spec;
    const at = (value) => Math.round((SLIDER_STEPS * (value - low)) / (high - low));
    const slider = make("input", { type: "range", min: 0, max: SLIDER_STEPS, step: "any", value: at(this.value ?? low) });
    slider.setAttribute("aria-label", `${label}, slider`);
    slider.title = `${this.range()}. Shift and an arrow key: fine steps`;
    const take = () => {
      this.set(low + (Number(slider.value) / SLIDER_STEPS) * (high - low));
      this.changed(this.value);
    };
    slider.oninput = take;
    slider.onkeydown = (event) => {
      const way = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
      if (!way) return;
      event.preventDefault();
      slider.value = Number(slider.value) + way * (event.shiftKey ? 1 : 10);
      take();
    };
    this.follow = () => this.value !== null && (slider.value = at(this.value));
    this.input.addEventListener("input", this.follow);
    // Whether the user is changing the value.
    this.isBusy = () => document.activeElement === this.input || slider.matches(":active");
    return slider;
  }
}
