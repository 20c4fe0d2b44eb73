// The user's desks of a rig: their tabs, and how they are stored, exported and imported.

import { download, make } from "./dom.js";
import { kindOf } from "./panels.js";
import { columnOf } from "./signals.js";

export const FORMAT = "anhyst-desks";
export const MAX_DESKS = 8;

export class Desks {
  // `opened` is called with a desk's index after the user opens it, and after the tabs have changed.
  constructor(place, tabs, context, opened) {
    Object.assign(this, { place, tabs, context, opened });
    this.layouts = context.bench.choices.get("desks", null) ?? [firstDesk(context.bench)];
    this.build();
  }

  build() {
    this.desks = []; // opened desks by their index
    this.place.replaceChildren();
    this.#list();
  }

  // Makes a desk when it is opened for the first time.
  async open(n) {
    const layout = this.layouts[n];
    const { Desk } = await import("./desk.js");
    if (this.desks[n] || this.layouts[n] !== layout) return;
    const changed = () => {
      this.context.bench.choices.set("desks", this.layouts);
      this.#list();
    };
    const desk = new Desk(this.context, layout, changed);
    desk.tools.append(...this.#tools());
    this.desks[n] = desk;
    this.place.append(desk.element);
  }

  #list() {
    const buttons = this.layouts.map(({ name }, n) => {
      const tab = make("button", { textContent: name, role: "tab", onclick: () => this.opened(n) });
      tab.dataset.view = `desk ${n}`;
      return tab;
    });
    const add = make("button", { textContent: "+", title: "Add a desk", onclick: () => this.#add() });
    add.setAttribute("aria-label", "add a desk");
    add.disabled = this.layouts.length >= MAX_DESKS;
    this.tabs.replaceChildren(...buttons);
    this.tabs.nextElementSibling.replaceChildren(add);
    this.opened(null);
  }

  #tools() {
    const file = make("input", { type: "file", accept: ".json", hidden: true });
    file.onchange = () => file.files[0] && this.import(file.files[0]);
    const button = (textContent, title, onclick) => make("button", { textContent, title, onclick });
    return [
      button("Export", "Save all desks of this rig as a file", () => this.export()),
      button("Import", "Replace all desks of this rig by those of a file", () => file.click()),
      button("Remove desk", "Remove this desk and its panels", () => this.#remove()),
      file,
    ];
  }

  #add() {
    this.#store([...this.layouts, { name: `Desk ${this.layouts.length + 1}`, panels: [] }], this.layouts.length);
    this.tabs.scrollLeft = this.tabs.scrollWidth;
  }

  #remove() {
    const left = this.layouts.filter((_, n) => n !== this.current);
    this.#store(left.length ? left : [{ name: "Desk", panels: [] }], 0);
  }

  #store(layouts, shown) {
    this.layouts = layouts;
    this.context.bench.choices.set("desks", layouts);
    this.build();
    this.opened(shown);
  }

  export() {
    const { bench } = this.context;
    const derived = bench.signals.filter((one) => one.expression).map(({ name, expression, unit }) => ({ name, expression, unit }));
    const content = { format: FORMAT, version: 1, desks: this.layouts, derived };
    const blob = new Blob([`${JSON.stringify(content, null, 1)}\n`], { type: "application/json" });
    download(`${bench.title.replace(/\W+/g, "-")}.desks.json`, blob);
  }

  async import(file) {
    const { notify, order, bench } = this.context;
    let content = null;
    try {
      content = JSON.parse(await file.text());
    } catch {
      // reported below
    }
    const { faultOf } = await import("./desk.js");
    const wrong = faultOf(content);
    if (wrong) return notify(`${file.name}: ${wrong}`);
    for (const derived of content.derived ?? [])
      if (columnOf(bench, derived.name) < 0) await order("derive", derived);
    const unknown = new Set(content.desks.flatMap(({ panels }) => panels.map(({ kind }) => kind)).filter((kind) => !kindOf(kind)));
    for (const desk of content.desks) desk.panels = desk.panels.filter(({ kind }) => !unknown.has(kind));
    if (unknown.size) notify(`${file.name}: imported without the panels of unknown kind: ${[...unknown].join(", ")}`);
    return this.#store(content.desks, 0);
  }
}

// Returns the desk that a rig shows before the user has made one.
function firstDesk(bench) {
  const { signal, reference } = bench.aim;
  return {
    name: "Desk",
    panels: [
      { kind: "plot", x: 0, y: 0, w: 8, h: 8, settings: { signals: [signal, reference] } },
      { kind: "loop", x: 8, y: 0, w: 4, h: 8, settings: {} },
      { kind: "slider", x: 0, y: 8, w: 4, h: 2, settings: { of: "target" } },
      { kind: "gauge", x: 0, y: 10, w: 4, h: 2, settings: {} },
      { kind: "number", x: 4, y: 8, w: 3, h: 4, settings: { signal } },
      { kind: "table", x: 7, y: 8, w: 5, h: 4, settings: {} },
    ],
  };
}
