// A plot over time: some signals, one strip for each of their units. All time plots share the scope's time.

import { make } from "./dom.js";
import { columnOf } from "./signals.js";
import { Strip } from "./strip.js";

export class TimePlot {
  #size = { width: 0, height: 0 };
  #drawn = ""; // state and size of the last picture

  // `changed` receives the names of the signals after each change.
  constructor(scope, names, changed) {
    this.scope = scope;
    this.changed = changed;
    this.names = new Set(names);
    this.stripsPlace = make("div", { className: "strips", tabIndex: 0, role: "group", ariaLabel: "signals over time" });
    this.stripsPlace.onkeydown = (event) => {
      if (event.target === this.stripsPlace) scope.key(event);
    };
    this.hint = make("p", {
      className: "empty",
      textContent: "No signals yet. Drag a signal from the list into this plot, or tick it in the list.",
    });
    this.element = make("div", { className: "timeplot" }, this.hint, this.stripsPlace);
    this.stripsPlace.title = "Click, or Enter and the arrow keys: cursors A and B. Drag or wheel: zoom. Double click: back.";
    new ResizeObserver(([{ contentRect }]) => {
      this.#size = { width: Math.floor(contentRect.width), height: Math.floor(contentRect.height) };
    }).observe(this.stripsPlace);
    this.element.ondragover = (event) => event.preventDefault();
    this.element.ondrop = (event) => this.#drop(event);
    this.build();
  }

  // Adds a dropped signal, or overlays a dropped recording.
  #drop(event) {
    event.preventDefault();
    event.stopPropagation();
    const [file] = event.dataTransfer.files;
    if (file) this.scope.overlay(file);
    else this.add(event.dataTransfer.getData("text/plain"));
  }

  get signals() {
    return this.scope.bench.signals.filter((signal) => this.names.has(signal.name));
  }

  add(name) {
    if (columnOf(this.scope.bench, name) < 0) return;
    this.names.add(name);
    this.#rebuild();
  }

  remove(name) {
    this.names.delete(name);
    this.#rebuild();
  }

  toggle(name) {
    if (this.names.has(name)) this.remove(name);
    else this.add(name);
  }

  #rebuild() {
    this.build();
    this.changed([...this.names]);
  }

  build() {
    this.stripsPlace.replaceChildren();
    this.#drawn = "";
    const { signals } = this;
    const units = [...new Set(signals.map((signal) => signal.unit))];
    this.hint.hidden = units.length > 0;
    this.strips = units.map((unit) => {
      const same = signals.filter((signal) => signal.unit === unit);
      return new Strip(this, unit, same, unit === units.at(-1));
    });
  }

  // Draws the strips if something has changed; `state` names everything that all plots share.
  draw(state) {
    const { width, height } = this.#size;
    const drawn = `${state} ${width} ${height}`;
    if (!width || drawn === this.#drawn) return;
    this.#drawn = drawn;
    const heights = Strip.heights(this.strips.length, height);
    for (const [n, strip] of this.strips.entries()) {
      strip.resize(width, heights[n]);
      strip.show(this.scope.store, this.scope.view);
    }
  }

  // Shows the values of a row in the legends.
  read(row) {
    for (const strip of this.strips) strip.read(this.scope.store, row);
  }

  restyle() {
    for (const strip of this.strips) strip.plot.redraw();
  }
}
