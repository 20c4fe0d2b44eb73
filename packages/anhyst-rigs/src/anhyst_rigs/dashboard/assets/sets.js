// Parameter sets: saves the active values under a name, compares two sets, stages a set.

import { NAME as COMPENSATION } from "./compensation.js";
import { field, make, refuse } from "./dom.js";
import { describe } from "./names.js";
import { showParameter } from "./quantity.js";

const ACTIVE = "active values";

export class Sets {
  #names = null;
  #compared = null;

  constructor(place, parameters, order) {
    this.parameters = parameters;
    this.order = order;
    this.name = make("input", { id: "set-name", size: 12, placeholder: "name" });
    this.first = make("select", { id: "set-first" });
    this.second = make("select", { id: "set-second" });
    this.rows = make("tbody");
    this.note = make("output", { className: "reading", id: "set-note" });
    const button = (id, textContent, onclick) => make("button", { id, textContent, onclick });
    this.saveButton = button("set-save", "Save", () => this.save());
    const bar = make(
      "div",
      { className: "bar", id: "sets" },
      field("Active values as", this.name),
      this.saveButton,
      field("Compare", this.first),
      field("with", this.second),
      button("set-stage", "Stage the second", () => this.stage()),
      this.note,
    );
    place.firstChild.after(bar, make("table", { id: "differences" }, this.rows));
    this.first.onchange = this.second.onchange = () => this.compare();
  }

  // Updates the names of all sets; compares again if the active values have changed.
  status({ sets, refused }) {
    refuse(this.saveButton, refused.sets);
    if (this.#compared && this.#compared !== this.parameters.parameters) this.compare();
    if (sets.join() === this.#names?.join()) return;
    this.#names = sets;
    for (const choice of [this.first, this.second]) {
      const chosen = choice.value || ACTIVE;
      const names = [ACTIVE, ...sets];
      choice.replaceChildren(
        ...names.map((name) => make("option", { value: name, textContent: name })),
      );
      choice.value = chosen;
    }
  }

  async save() {
    const answer = await this.order("save set", { name: this.name.value.trim() });
    if (!answer) return;
    this.note.textContent = `saved as ${answer.file}`;
    this.name.value = "";
  }

  async stage() {
    const name = this.second.value;
    if (name === ACTIVE) {
      this.note.textContent = "choose a saved set as the second";
      return;
    }
    const answer = await this.order("read set", { name });
    if (!answer) return;
    this.parameters.stage(answer.differing);
    const count = Object.keys(answer.differing).length;
    this.note.textContent = count ? `${count} staged, apply them` : "nothing differs";
  }

  async compare() {
    this.#compared = this.parameters.parameters;
    const held = await Promise.all([this.first, this.second].map((one) => this.#values(one.value)));
    if (held.some((one) => one === null)) return;
    const [first, second] = held;
    const differing = this.parameters.parameters.filter(({ name }) => first[name]?.value !== second[name]?.value);
    const head = ["", this.first.value, this.second.value, "difference"];
    this.rows.replaceChildren(
      make("tr", {}, ...head.map((text) => make("th", { textContent: text }))),
      ...differing.map((one) => row(one, first[one.name], second[one.name])),
    );
    this.note.textContent = differing.length ? "" : "the values are equal";
  }

  async #values(name) {
    if (name === ACTIVE)
      return Object.fromEntries(this.parameters.parameters.map((one) => [one.name, one]));
    return (await this.order("read set", { name }))?.parameters ?? null;
  }
}

// Returns a row with a parameter in two sets and its difference; a set need not contain it.
function row(parameter, first, second) {
  const text = (value) => showParameter({ ...parameter, value });
  const isNumber = first && second && parameter.name !== COMPENSATION;
  const cells = [...[first, second].map((one) => (one ? text(one.value) : "–")), isNumber ? text(second.value - first.value) : "–"];
  return make(
    "tr",
    {},
    make("th", { textContent: describe(parameter).label, scope: "row", title: parameter.name }),
    ...cells.map((one) => make("td", { textContent: one })),
  );
}
