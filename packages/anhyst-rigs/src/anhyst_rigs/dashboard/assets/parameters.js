// Parameters as a tree: edited values are staged, applied together, confirmed by a tick.

import { NAME as COMPENSATION } from "./compensation.js";
import { make, refuse } from "./dom.js";
import { describe, sign, words } from "./names.js";
import { Quantity, showParameter } from "./quantity.js";

export class Parameters extends EventTarget {
  #staged = new Map();
  #before = null; // active values before the last change
  #fields = new Map(); // fields of the values by parameter
  #eras = []; // active values in words, with the first tick of each
  #last = Promise.resolve(); // last request; each waits for the previous one, so that it uses the active values

  #refused = ""; // reason why no values can be applied now

  constructor(place, order, choices) {
    super();
    this.order = order;
    this.choices = choices;
    this.closed = new Set(choices.get("closed", []));
    this.confirmed = make("output", { className: "reading", id: "confirmed" });
    this.applyButton = make("button", { id: "apply", onclick: () => this.apply() });
    this.discardButton = make("button", { textContent: "Discard", title: "Forget the staged values", onclick: () => this.discard() });
    this.backButton = make("button", {
      textContent: "Roll back (B)",
      title: "Restore the values before the last change",
      onclick: () => this.rollBack(),
    });
    const bar = make(
      "div",
      { className: "bar" },
      this.applyButton,
      this.discardButton,
      this.backButton,
      this.confirmed,
    );
    this.tree = make("div", { className: "tree scroll" });
    place.replaceChildren(bar, this.tree);
  }

  // Stores the active values from a tick on; staged values are not changed.
  take(parameters, applied) {
    this.parameters = parameters;
    this.#eras.push({ from: applied, words: this.#words() });
    this.show();
  }

  show() {
    const { parameters } = this;
    this.#fields.clear();
    const groups = Map.groupBy
      ? Map.groupBy(parameters, group)
      : parameters.reduce(
          (all, one) => all.set(group(one), [...(all.get(group(one)) ?? []), one]),
          new Map(),
        );
    const branches = [...groups].map(([name, members]) => this.#branch(name, members));
    this.tree.replaceChildren(...branches);
    if (!parameters.length)
      this.tree.replaceChildren(make("p", { className: "empty", textContent: "This rig has no parameters that can be changed while it runs." }));
    this.#refresh();
    this.dispatchEvent(new Event("shown"));
  }

  #branch(name, members) {
    const summary = make("summary", { textContent: name });
    const open = !this.closed.has(name);
    const branch = make("details", { open }, summary, this.#table(members));
    branch.ontoggle = () => {
      if (branch.open) this.closed.delete(name);
      else this.closed.add(name);
      this.choices.set("closed", [...this.closed]);
    };
    return branch;
  }

  #table(members) {
    const rows = members.map((one) => this.#row(one));
    return make("table", {}, make("tbody", {}, ...rows));
  }

  #row(one) {
    const { label, symbol } = describe(one);
    const spec = { ...one, label, value: this.#staged.get(one.name) ?? one.value };
    const field = new Quantity(spec, (value) => this.#stage(one, value));
    field.input.addEventListener("input", () => this.#refresh());
    field.input.addEventListener("keydown", (event) => event.key === "Enter" && event.ctrlKey && !this.applyButton.disabled && this.apply());
    this.#fields.set(one.name, field);
    const name = make("th", { scope: "row", title: `${one.name}: ${one.doc}` }, label, sign(symbol));
    const isSwitch = one.name === COMPENSATION;
    const control = isSwitch ? this.#checkbox(one, field) : field.slider();
    const cells = [control, make("div", { hidden: isSwitch }, ...field.elements, field.message)];
    return make(
      "tr",
      {},
      name,
      ...cells.map((cell) => make("td", {}, cell)),
      make("td", { textContent: `now ${showParameter(one)}` }),
      make("td", { className: "soft", textContent: isSwitch ? "off or on" : field.range() }),
      make("td", { className: "soft", textContent: one.doc }),
    );
  }

  // Returns a checkbox for a parameter that is 0 or 1.
  #checkbox(one, field) {
    const box = make("input", { type: "checkbox", checked: field.value !== 0, ariaLabel: `${field.spec.label}, on` });
    box.onchange = () => {
      field.set(Number(box.checked));
      this.#stage(one, field.value);
    };
    return box;
  }

  #stage(one, value) {
    const same = Math.abs(value - one.value) <= 1e-6 * Math.abs(one.value);
    if (same) this.#staged.delete(one.name);
    else this.#staged.set(one.name, value);
    this.#refresh();
  }

  #refresh() {
    const count = this.#staged.size;
    this.applyButton.textContent = count ? `Apply ${count} staged (Ctrl+Enter)` : "Nothing staged";
    this.applyButton.classList.toggle("primary", count > 0);
    const nothing = count ? "" : "nothing is staged";
    const wrong = [...this.#fields.values()].find((field) => !field.message.hidden);
    refuse(this.applyButton, this.#refused || (wrong ? `${wrong.spec.label}: ${wrong.message.textContent}` : nothing));
    refuse(this.discardButton, nothing);
    refuse(this.backButton, this.#refused || (this.#before ? "" : "no change was applied yet"));
    for (const [name, { input }] of this.#fields)
      input.classList.toggle("staged", this.#staged.has(name));
  }

  status({ refused }) {
    if (this.#refused === (refused.apply ?? "")) return;
    this.#refused = refused.apply ?? "";
    this.#refresh();
  }

  // Stages values by name, in addition to those that are already staged.
  stage(values) {
    for (const [name, value] of Object.entries(values)) this.#staged.set(name, value);
    this.show();
  }

  discard() {
    this.#staged.clear();
    this.show();
  }

  apply() {
    return this.#inTurn(() => this.#staged.size && this.#put(Object.fromEntries(this.#staged)));
  }

  rollBack() {
    return this.#inTurn(() => this.#before && this.#put(this.#before));
  }

  value(name) {
    return this.parameters.find((one) => one.name === name)?.value;
  }

  // Toggles a parameter between 0 and 1, if it exists.
  toggle(name) {
    return this.#inTurn(() => {
      const value = this.value(name);
      return value !== undefined && this.#put({ [name]: value === 0 ? 1 : 0 });
    });
  }

  // Applies values together; other values stay staged.
  put(values) {
    return this.#inTurn(() => this.#put(values));
  }

  #inTurn(act) {
    this.#last = this.#last.then(act, act);
    return this.#last;
  }

  async #put(values) {
    const old = this.parameters
      .filter((one) => one.name in values)
      .map((one) => [one.name, one.value]);
    const answer = await this.order("apply", { values });
    if (!answer) return null;
    this.#before = Object.fromEntries(old);
    for (const name of Object.keys(values)) this.#staged.delete(name);
    this.confirmed.textContent = `Active from tick ${answer.applied} on`;
    this.take(answer.parameters, answer.applied);
    return answer;
  }

  // Returns a short text on the values that were active at a tick, to distinguish steps.
  label(tick) {
    return (this.#eras.findLast((era) => era.from <= tick) ?? this.#eras[0]).words;
  }

  #words() {
    const on = this.value("compensation");
    const texts = on === undefined ? [] : [on === 0 ? "without compensation" : "with compensation"];
    for (const one of this.parameters) {
      const share = one.value / one.first; // `first` is the same for all browsers
      if (one.name.startsWith("gain_") && Math.abs(share - 1) > 1e-6)
        texts.push(`${describe(one).label} × ${Number(share.toPrecision(3))}`);
    }
    return texts.join(", ") || "as compiled";
  }
}

function group(one) {
  return words(one.name.split(/[._]/)[0]);
}
