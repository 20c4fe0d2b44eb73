// Desks: tabs of the user with panels that are added, removed, moved and resized, by pointer or by keyboard.

import { FORMAT, MAX_DESKS } from "./desks.js";
import { make } from "./dom.js";
import { COLUMNS, free, limited, settle } from "./grid.js";
import { kindOf, kinds } from "./panels.js";

const ROWS = 12; // number of grid rows that fill the view
const MIN_ROW_PX = 40; // smallest height of a grid row, pixels
const GAP_PX = 8; // distance between two panels, pixels
const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Desk {
  // `layout`: {name, panels: [{kind, x, y, w, h, settings}]}; `changed` is called after each change of it.
  constructor(context, layout, changed) {
    this.context = context;
    this.layout = layout;
    this.changed = changed;
    this.grid = make("div", { className: "grid" });
    this.empty = make("p", { className: "empty", textContent: "This desk is empty. Add a panel, or drag a signal here to plot it." });
    this.element = make("div", { className: "view desk" }, this.#bar(), this.empty, this.grid);
    this.element.ondragover = (event) => event.preventDefault();
    this.element.ondrop = (event) => this.#drop(event);
    new ResizeObserver(([{ contentRect }]) => this.#scale(contentRect.height)).observe(this.element);
    this.open = [];
    for (const entry of layout.panels) this.#open(entry);
    this.#place();
  }

  #bar() {
    const menu = make("select", {}, make("option", { value: "", textContent: "Add panel" }));
    menu.setAttribute("aria-label", "add a panel");
    for (const { kind, title } of kinds(this.context.bench)) menu.append(make("option", { value: kind, textContent: title }));
    menu.onchange = () => {
      if (menu.value) this.add(menu.value);
      menu.value = "";
    };
    const name = make("input", { value: this.layout.name, size: 12, maxLength: 24 });
    name.setAttribute("aria-label", "name of the desk");
    name.onchange = () => {
      this.layout.name = name.value.trim() || "Desk";
      this.changed();
    };
    this.tools = make("span", { className: "line" });
    return make("div", { className: "bar" }, menu, name, this.tools);
  }

  // Adds a panel of a kind in the first free place.
  add(kind, settings = {}) {
    const entry = { kind, ...free(this.layout.panels, kindOf(kind).size), settings };
    this.layout.panels.push(entry);
    this.#open(entry);
    this.#place();
    this.changed();
    return entry;
  }

  #open(entry) {
    const kind = kindOf(entry.kind);
    if (!kind) return;
    const shown = { entry, panel: {} }; // the panel follows when its code is loaded
    const title = make("h2", { textContent: kind.title, tabIndex: 0 });
    title.title = "Drag, or press the arrow keys: move. Shift and arrow keys: resize. Delete: remove.";
    const remove = make("button", { className: "small", textContent: "×", onclick: () => this.remove(entry) });
    remove.setAttribute("aria-label", `remove ${kind.title}`);
    const tools = make("span", { className: "tools" });
    const corner = make("div", { className: "corner", title: "Drag to resize" });
    const body = make("div", { className: "body" });
    const frame = shown.frame = make("section", { className: "panel" }, make("header", {}, title, tools, remove), body, corner);
    frame.setAttribute("aria-label", kind.title);
    for (const way of ["pointerdown", "focusin"])
      frame.addEventListener(way, () => (this.active = shown.panel.plot ?? this.active));
    title.onkeydown = (event) => this.#key(event, entry, title);
    this.#drag(title, entry, (at, cells) => ({ ...at, x: at.x + cells[0], y: at.y + cells[1] }));
    this.#drag(corner, entry, (at, cells) => ({ ...at, w: at.w + cells[0], h: at.h + cells[1] }));
    frame.ondragover = (event) => event.preventDefault();
    frame.ondrop = (event) => {
      const name = event.dataTransfer.getData("text/plain");
      event.preventDefault();
      event.stopPropagation();
      if (name) shown.panel.drop?.(name);
    };
    this.open.push(shown);
    this.grid.append(frame);
    this.#fill(shown, kind, tools, body);
  }

  // Makes the panel in its frame.
  async #fill(shown, kind, tools, body) {
    const { entry } = shown;
    const save = (settings) => {
      entry.settings = settings;
      this.changed();
    };
    shown.panel = await kind.make(this.context, entry.settings ?? {}, save);
    const { status } = this.context;
    if (status) shown.panel.status?.(status);
    tools.append(...(shown.panel.tools ?? []));
    body.append(shown.panel.element);
  }

  remove(entry) {
    const at = this.open.findIndex((one) => one.entry === entry);
    const [{ frame, panel }] = this.open.splice(at, 1);
    panel.close?.();
    frame.remove();
    if (this.active === panel.plot) this.active = null;
    this.layout.panels = this.layout.panels.filter((one) => one !== entry);
    this.#place();
    this.changed();
  }

  // Moves or resizes a panel while the pointer drags an element.
  #drag(handle, entry, moved) {
    handle.onpointerdown = (down) => {
      if (down.button) return;
      handle.setPointerCapture(down.pointerId);
      const begin = { x: entry.x, y: entry.y, w: entry.w, h: entry.h };
      const cell = [(this.grid.clientWidth + GAP_PX) / COLUMNS, this.rowPx + GAP_PX];
      handle.onpointermove = (move) => {
        const cells = [move.clientX - down.clientX, move.clientY - down.clientY].map((way, n) => Math.round(way / cell[n]));
        this.#put(entry, moved(begin, cells));
      };
      handle.onpointerup = handle.onpointercancel = () => {
        handle.onpointermove = null;
        this.changed();
      };
    };
  }

  #put(entry, place) {
    Object.assign(entry, limited(place));
    settle(this.layout.panels, entry);
    this.#place();
  }

  #key(event, entry, title) {
    if (event.key === "Delete") {
      this.remove(entry);
      return;
    }
    const [right, down] = MOVES[event.key] ?? [];
    if (right === undefined) return;
    event.preventDefault();
    const { x, y, w, h } = entry;
    this.#put(entry, event.shiftKey ? { x, y, w: w + right, h: h + down } : { x: x + right, y: y + down, w, h });
    this.changed();
    title.focus();
  }

  // Drops a signal next to the panels as a new plot, or overlays a recording.
  #drop(event) {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    const name = event.dataTransfer.getData("text/plain");
    if (file) this.context.scope.overlay(file);
    else if (name) this.add("plot", { signals: [name] });
  }

  #scale(height) {
    const bar = this.element.firstChild.offsetHeight;
    this.rowPx = Math.max(MIN_ROW_PX, Math.floor((height - bar + GAP_PX) / ROWS) - GAP_PX);
    this.grid.style.gridAutoRows = `${this.rowPx}px`;
  }

  #place() {
    this.empty.hidden = this.open.length > 0;
    for (const { entry, frame } of this.open) {
      frame.style.gridColumn = `${entry.x + 1} / span ${entry.w}`;
      frame.style.gridRow = `${entry.y + 1} / span ${entry.h}`;
      frame.style.order = 100 * entry.y + entry.x; // the sequence in the single column of a phone
    }
  }

  // Returns the plot in which the list of signals shows its ticks.
  plot() {
    return this.active ?? this.open.find(({ panel }) => panel.plot)?.panel.plot ?? this.context.scope.plot;
  }

  draw() {
    const { scope, store } = this.context;
    if (!store.count) return;
    scope.drawPlots(new Set(this.open.map(({ panel }) => panel.plot).filter(Boolean)));
    for (const { panel } of this.open) panel.draw?.();
  }

  status(status) {
    for (const { panel } of this.open) panel.status?.(status);
  }

  table() {
    const loop = this.open.find(({ panel }) => panel.table);
    return this.open.some(({ panel }) => panel.plot) || !loop ? this.context.scope.table() : loop.panel.table();
  }

  words() {
    return [...this.context.scope.words(), ...this.open.flatMap(({ panel }) => panel.words?.() ?? [])];
  }
}

// Returns why a file is not a file of desks; an empty text if it is.
export function faultOf(content) {
  if (content?.format !== FORMAT) return "is not a file of desks; choose one that Export has saved";
  if (content.version !== 1) return `has version ${content.version}, but this page reads version 1`;
  const isPlace = (one) => typeof one?.kind === "string" && ["x", "y", "w", "h"].every((key) => Number.isInteger(one[key]));
  const isDesk = (desk) => typeof desk?.name === "string" && Array.isArray(desk.panels) && desk.panels.every(isPlace);
  const { desks } = content;
  const valid = Array.isArray(desks) && desks.length > 0 && desks.length <= MAX_DESKS && desks.every(isDesk);
  return valid ? "" : "contains a desk without a name or a panel without a place";
}
