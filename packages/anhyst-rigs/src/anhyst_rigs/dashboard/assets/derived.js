// The form that defines a derived signal by an expression. The server calculates it for pages and recordings.

import { make } from "./dom.js";

const EXAMPLE = "lowpass(force_N * current_A, 200)";
const HELP = `A signal calculated from others in SI units, also in recordings.
Operators: + - * / **, parentheses, numbers, signals by name or with their unit.
Functions: derivative(x), lowpass(x, Hz), highpass(x, Hz), rms(x, s), mean(x, s), abs(x), sqrt(x), min(x, y), max(x, y).`;

export class DerivedForm {
  constructor(bench, order) {
    this.order = order;
    const input = (id, placeholder, label) => {
      const element = make("input", { id, placeholder, autocomplete: "off" });
      element.setAttribute("aria-label", label);
      return element;
    };
    this.name = input("derived-name", "name, such as power", "name of the derived signal");
    this.expression = input("derived-expression", EXAMPLE, "expression of the derived signal");
    this.unit = input("derived-unit", "unit, such as W", "unit of the derived signal");
    this.wrong = make("output", { className: "invalid" });
    const add = make("button", { id: "derived-add", textContent: "Add signal", onclick: () => this.#add() });
    this.expression.onkeydown = (event) => {
      if (event.key === "Enter") this.#add();
    };
    const help = make("p", { className: "soft", textContent: HELP });
    const summary = make("summary", { textContent: "Derived signal" });
    this.element = make("details", { id: "derived" }, summary, this.name, this.expression, this.unit, add, this.wrong, help);
  }

  async #add() {
    const [name, expression, unit] = [this.name, this.expression, this.unit].map((one) => one.value.trim());
    this.awaited = name; // the list of signals shows it when it comes
    const answer = await this.order("derive", { name, expression, unit }, (reason) => (this.wrong.textContent = reason));
    if (!answer) {
      this.awaited = null;
      return;
    }
    for (const one of [this.name, this.expression, this.unit]) one.value = "";
    this.wrong.textContent = "";
  }

  removeButton(name) {
    const remove = () => this.order("derive", { name, expression: null });
    const button = make("button", { className: "small", textContent: "×", onclick: remove });
    button.setAttribute("aria-label", `delete ${name}`);
    return button;
  }
}
