// The learning view: parameters estimated from the motion over the cycles, and the error.

import { Plane, limits } from "./canvas.js";
import { COLOURS } from "./colours.js";
import { field, make, refuse, select } from "./dom.js";
import { words } from "./names.js";

// Name, group, unit and factor from SI of each kind of parameter.
const KINDS = {
  scale: ["Scale error", "scales", "%", 100],
  gap_zero_m: ["Zero of the gap", "gap zeros", "µm", 1e6],
  width: ["Width of the loops", "widths", "%", 100],
  payload: ["Payload, relative to the mass", "body", "%", 100],
  lag_s: ["Lag of the flux", "lag", "µs", 1e6],
  bias_N: ["Constant force", "body", "N", 1],
  cable_N_per_m: ["Stiffness of the cable", "body", "N/m", 1],
  centre_x_m: ["Centre of mass, x", "body", "µm", 1e6],
  centre_y_m: ["Centre of mass, y", "body", "µm", 1e6],
  centre_z_m: ["Centre of mass, z", "body", "µm", 1e6],
};
const MAX_SHOWN_PARAMETERS = 8; // with more parameters, one kind or magnet is selected
const ERRORS = {
  m: { what: "moving average", axis: "moving average of the error / nm", unit: "nm", factor: 1e9 },
  N: { what: "unexplained force", axis: "unexplained force, rms / N", unit: "N", factor: 1 },
};

export class Learning {
  #shown = ""; // key of the drawn content and its size
  #laps = [];
  #now = null;

  constructor(place, bench, order) {
    this.bench = bench;
    this.of = ERRORS[bench.learns];
    this.button = make("button", { id: "learn", onclick: () => order("learn", { on: !this.#now?.on }) });
    this.back = make("button", { textContent: "Revert", title: "Discard all estimates and remove the corrections", onclick: () => order("learn", { revert: true }) });
    this.gained = make("output", { className: "reading", id: "gained" });
    this.said = make("output", { className: "soft", id: "learnt-said" });
    this.legend = make("span");
    const kinds = [...new Set(Object.values(KINDS).map(([, group]) => group))].map((one) => [one, one]);
    const magnets = (bench.body?.magnets ?? []).map(({ name }, n) => [String(n + 1), `magnet ${name}`]);
    this.kind = select([...kinds, ...magnets], "scales");
    this.kind.id = "learnt-kind";
    this.kind.onchange = () => this.#again();
    this.group = field("Shown", this.kind);
    this.group.hidden = true;
    this.figures = make("div", { className: "scroll figures", tabIndex: 0, role: "region", ariaLabel: "figures" });
    const left = make("figure");
    const right = make("figure");
    this.values = new Plane(left, "t / s", "estimate / stated standard deviation");
    this.errors = new Plane(right, "t / s", this.of.axis);
    place.replaceChildren(
      make("div", { className: "bar" }, this.button, this.back, this.group, this.gained),
      make("div", { className: "bar" }, this.said, this.legend),
      this.figures,
      make("div", { className: "pair" }, left, right),
    );
    this.learnt(bench.laps);
  }

  // Shows the cycles.
  learnt(laps) {
    this.#laps = laps;
    this.#again();
    this.#gain();
  }

  #again() {
    this.#shown = "";
    this.figures.replaceChildren(this.#table());
  }

  // Returns the parameters to show: all, or if there are many, those of the selected kind or magnet.
  #names({ values = {} } = {}) {
    const names = Object.keys(values);
    this.group.hidden = names.length <= MAX_SHOWN_PARAMETERS;
    const { value } = this.kind;
    const shown = (name) => kindOf(name)[1] === value || numberOf(name) === value;
    return this.group.hidden ? names : names.filter(shown);
  }

  status({ learn, refused }) {
    if (!learn) return;
    this.#now = learn;
    this.button.textContent = learn.on ? "Stop learning" : "Learn from the motion";
    this.button.setAttribute("aria-pressed", String(learn.on));
    refuse(this.button, refused.learn || (learn.on ? "" : learn.refused));
    refuse(this.back, refused.learn);
    const last = this.#laps.at(-1);
    const left = learn.left_out ? `${learn.left_out} cycles left out, because an estimate takes longer than a cycle` : "";
    const parts = [learn.trouble, last && learn.said[last.method], left].filter(Boolean);
    const moved = this.bench.learns === "m" ? "press Run" : "start the generator";
    const waits = learn.on ? `waits for a motion: ${moved}` : "no estimate yet";
    this.said.textContent = parts.join("; ") || waits;
    this.#gain();
  }

  #gain() {
    const last = this.#laps.at(-1);
    if (!last || !this.#now) return;
    const before = this.#now.before[last.method];
    const { what, unit, factor } = this.of;
    const text = (value) => `${short(factor * value)} ${unit}`;
    const were = before === undefined ? "" : `${text(before)} before, `;
    this.gained.textContent = `${words(this.bench.methods[last.method])}: ${what} ${were}${text(last.average)} now, peak ${text(last.peak)}`;
  }

  // Returns the cycles that used the same method as the last cycle.
  #own() {
    const method = this.#laps.at(-1)?.method;
    return this.#laps.filter((one) => one.method === method);
  }

  #table() {
    const { values } = this.#laps.at(-1) ?? {};
    const names = this.#names(this.#laps.at(-1));
    if (!names.length) return "";
    const row = (name) => {
      const [value, sigma, applied, stated] = values[name];
      const [text, , unit, factor] = kindOf(name);
      const cells = [
        `${short(factor * value)} ± ${short(2 * factor * sigma)} ${unit}`,
        `${short(factor * applied)} ${unit}`,
        `± ${short(2 * factor * stated)} ${unit}`,
      ];
      const head = make("th", { textContent: text + this.#magnetOf(name), scope: "row", title: name });
      head.style.color = colour(names.indexOf(name));
      return make("tr", {}, head, ...cells.map((cell) => make("td", { textContent: cell })));
    };
    const heads = ["Parameter", "Learnt, two deviations", "Applied", "Stated, two deviations"];
    return make(
      "table",
      { id: "learnt" },
      make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { textContent: text })))),
      make("tbody", {}, ...names.map(row)),
    );
  }

  // Returns the magnet of a parameter in words; empty for a parameter of the whole rig.
  #magnetOf(name) {
    const number = numberOf(name);
    return number ? `, magnet ${this.bench.body?.magnets[number - 1]?.name ?? number}` : "";
  }

  draw() {
    const { clientWidth, clientHeight } = this.values.canvas.parentElement;
    const key = `${clientWidth} ${clientHeight} ${document.documentElement.dataset.theme}`;
    if (key === this.#shown) return;
    this.#shown = key;
    const own = this.#own();
    this.#drawValues(own.filter((one) => Object.keys(one.values).length));
    const times = this.#times(this.#laps);
    const averages = this.#laps.map((one) => this.of.factor * one.average);
    this.errors.begin([...limits(times), ...limits([0], averages)]);
    this.legend.replaceChildren();
    for (const [n, method] of [...new Set(this.#laps.map((one) => one.method))].entries()) {
      const dot = make("i", { className: "dot" });
      dot.style.background = COLOURS[n];
      this.legend.append(make("b", {}, dot, ` ${this.bench.methods[method]} `));
      const laps = this.#laps.filter((one) => one.method === method);
      for (const one of laps) this.errors.dot(one.tick / this.bench.rate, this.of.factor * one.average, COLOURS[n]);
    }
  }

  // Draws the estimates divided by the prior standard deviations, so that all fit into one plot.
  #drawValues(laps) {
    const times = this.#times(laps);
    const names = this.#names(laps.at(-1));
    const curves = names.map((name) => {
      const rows = laps.map(({ values }) => values[name] ?? [NaN, NaN, NaN, 1]);
      const part = (pick) => rows.map((row) => pick(row) / row[3]);
      return [part(([v]) => v), part(([v, s]) => v - 2 * s), part(([v, s]) => v + 2 * s)];
    });
    this.values.begin([...limits(times), ...limits([-1, 1], ...curves.flat())]);
    for (const [n, [value, low, high]] of curves.entries()) {
      this.values.band(times, low, high, colour(n), Math.min(0.22, 0.6 / curves.length));
      this.values.line(times, value, colour(n), 2);
      this.values.dot(times.at(-1), value.at(-1), colour(n));
    }
  }

  #times(laps) {
    return laps.map((one) => one.tick / this.bench.rate);
  }

  table() {
    const laps = this.#laps;
    const names = [...new Set(laps.flatMap((one) => Object.keys(one.values)))];
    const part = (name, n) => laps.map(({ values }) => values[name]?.[n] ?? "");
    return {
      t_s: this.#times(laps),
      method: laps.map((one) => one.method),
      [`average_${this.bench.learns}`]: laps.map((one) => one.average),
      [`peak_${this.bench.learns}`]: laps.map((one) => one.peak),
      ...Object.fromEntries(
        names.flatMap((name) => [
          [name, part(name, 0)],
          [`${name}_deviation`, part(name, 1)],
          [`${name}_applied`, part(name, 2)],
        ]),
      ),
    };
  }

  words() {
    const rows = [...this.figures.querySelectorAll("tbody tr")].map((row) => {
      const [head, value] = row.children;
      return [`${head.textContent} ${value.textContent}`, head.style.color];
    });
    const methods = [...this.legend.children].map((one) => [one.textContent, one.style.color]);
    return [[[this.gained.textContent], ...methods], rows];
  }
}

// Returns the number of the magnet of a parameter; undefined for a parameter of the whole rig.
const numberOf = (name) => name.match(/_(\d+)/)?.[1];
const kindOf = (name) => KINDS[name.replace(/_\d+/, "")];
const colour = (n) => COLOURS[n % COLOURS.length];

function short(value) {
  return String(Number(value.toPrecision(3)));
}
