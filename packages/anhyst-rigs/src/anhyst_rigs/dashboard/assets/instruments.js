// Panels that show signals: plot over time, loop of two signals, number, gauge and table.

import { Plane, atLeast, limits } from "./canvas.js";
import { VERMILION } from "./colours.js";
import { make } from "./dom.js";
import { NO_SIGNAL, columnOf, hint, leastSpan, reading, signalChoice, signalOf } from "./signals.js";
import { TimePlot } from "./timeplot.js";
import { show, shown } from "./units.js";

const UPDATE_MS = 100; // time between two updates of displayed values
const MAX_POINTS = 4000; // largest number of points of a loop
const MAX_STATISTICS_ROWS = 20000; // largest number of rows from which statistics are calculated

// Returns a function that calls `act` at most once per interval.
function paced(act, interval = UPDATE_MS) {
  let due = 0;
  return () => {
    const now = performance.now();
    if (now < due) return;
    due = now + interval;
    act();
  };
}

// Returns the mean, the rms about it, and the extremes of a column within the window.
function statistics({ store, scope, bench }, column) {
  const first = Math.max(store.find(store.newest - scope.window * bench.rate), store.count - MAX_STATISTICS_ROWS);
  let [sum, square, low, high, count] = [0, 0, Infinity, -Infinity, 0];
  const origin = store.value(column, store.count - 1); // differences keep the digits of the variance
  for (let row = first; row < store.count; row++) {
    const value = store.value(column, row) - origin;
    if (value !== value) continue;
    count++;
    sum += value;
    square += value * value;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  const mean = sum / count;
  const rms = Math.sqrt(Math.max(0, square / count - mean * mean));
  return { now: origin, mean: origin + mean, rms, low: origin + low, high: origin + high };
}

export function plot({ scope, bench }, settings, save) {
  const plot = new TimePlot(scope, settings.signals ?? [bench.aim.signal], (signals) => save({ signals }));
  return { element: plot.element, plot };
}

export function loop({ bench, scope }, settings, save) {
  const has = (name) => columnOf(bench, name) >= 0;
  const chosen = { x: has("current") ? "current" : bench.aim.reference, y: has("force") ? "force" : bench.aim.signal, ...settings };
  const figure = make("figure");
  const plane = new Plane(figure, "", "");
  const choices = {};
  const choose = (axis, name) => {
    chosen[axis] = name;
    choices[axis].choose(name);
    save({ ...chosen });
  };
  for (const axis of ["x", "y"])
    choices[axis] = signalChoice(bench, chosen[axis], `${axis} axis`, { onchange: () => choose(axis, choices[axis].value) });
  const points = () => {
    const { store } = scope;
    const first = store.find(scope.view.from);
    const end = store.find(scope.view.to + 1);
    const every = Math.max(1, Math.ceil((end - first) / MAX_POINTS));
    const rows = Array.from({ length: Math.ceil((end - first) / every) }, (_, n) => first + n * every);
    return ["x", "y"].map((axis) => {
      const signal = signalOf(bench, chosen[axis]);
      return { signal, values: rows.map((row) => store.value(signal.column, row)) };
    });
  };
  const missing = make("p", { className: "empty", textContent: NO_SIGNAL });
  const draw = paced(() => {
    const exists = has(chosen.x) && has(chosen.y);
    missing.hidden = exists;
    figure.hidden = !exists;
    if (!exists) return;
    const [x, y] = points().map(({ signal, values }) => {
      const { factor, name } = shown(signal.unit);
      return { signal, name, values: values.map((value) => value * factor), least: leastSpan(bench, scope.store, signal.unit) * factor };
    });
    plane.labels = [x, y].map(({ signal, name }) => [signal.label, name].filter(Boolean).join(" / "));
    plane.begin([x, y].flatMap(({ values, least }) => atLeast(limits(values), least)));
    plane.line(x.values, y.values, y.signal.colour, 1.5);
    if (x.values.length) plane.dot(x.values.at(-1), y.values.at(-1), VERMILION);
  }, 50);
  return {
    element: make("div", { className: "loop-panel" }, missing, figure),
    tools: [choices.y, "over", choices.x],
    draw,
    drop: (name) => choose("y", name),
    table: () => Object.fromEntries((has(chosen.x) && has(chosen.y) ? points() : []).map(({ signal, values }) => [signal.head, values])),
  };
}

export function number(context, settings, save) {
  const { bench } = context;
  let name = settings.signal ?? bench.aim.signal;
  const value = make("output", { className: "big" });
  const range = make("output", { className: "reading" });
  const choice = signalChoice(bench, name, "signal", { onchange: () => choose(choice.value) });
  const choose = (chosen) => {
    name = chosen;
    choice.choose(name);
    save({ signal: name });
  };
  const draw = paced(() => {
    const signal = signalOf(bench, name);
    if (!signal) return showMissing(value, range);
    const { now, mean, rms } = statistics(context, signal.column);
    value.textContent = reading(signal, now);
    value.title = hint(signal);
    range.textContent = signal.values ? "" : `mean ${show(mean, signal.unit, 6)}, rms about it ${show(rms, signal.unit, 3)}`;
  });
  return { element: make("div", { className: "number-panel" }, value, range), tools: [choice], draw, drop: choose };
}

// Shows that the signal of a panel does not exist.
function showMissing(value, note) {
  value.textContent = "–";
  note.textContent = NO_SIGNAL;
}

export function gauge(context, settings, save) {
  const { bench, store } = context;
  let name = settings.signal ?? (columnOf(bench, "current") < 0 ? bench.aim.signal : "current");
  let most = 0; // largest absolute value that was shown
  let least = 0; // smallest value that was shown; 0 without negative values
  const bar = make("i");
  const value = make("output", { className: "big" });
  const ends = make("div", { className: "ends" }, make("span"), make("span"));
  const choice = signalChoice(bench, name, "signal", { onchange: () => choose(choice.value) });
  const choose = (chosen) => {
    name = chosen;
    choice.choose(name);
    most = least = 0;
    save({ signal: name });
  };
  const draw = paced(() => {
    const signal = signalOf(bench, name);
    if (!signal) return showMissing(value, ends.firstChild);
    const now = store.value(signal.column, store.count - 1);
    most = Math.max(most, store.largest(signal.column, Math.max(0, store.count - bench.rate)));
    least = Math.min(least, now);
    const [low, high] = gaugeRange(bench, signal, most, least);
    const share = Math.min(1, Math.max(0, (now - low) / (high - low)));
    bar.style.width = `${100 * share}%`;
    bar.style.background = signal.colour;
    value.textContent = reading(signal, now, 4);
    for (const [n, end] of [low, high].entries()) ends.children[n].textContent = show(end, signal.unit, 3);
  });
  return { element: make("div", { className: "gauge-panel" }, value, make("div", { className: "track" }, bar), ends), tools: [choice], draw, drop: choose };
}

// Returns the range of a gauge: that of the demand for the controlled quantity, or a round number above all values.
function gaugeRange({ aim }, { name, unit }, most, least) {
  if (!aim.is_offset && [aim.signal, aim.reference].includes(name)) return [aim.low, aim.high];
  const power = 10 ** Math.floor(Math.log10(most || 1));
  const high = [1, 2, 5, 10].find((one) => one * power >= most) * power;
  return [unit === "m" && least >= 0 ? 0 : -high, high];
}

export function table(context, settings, save) {
  const { bench } = context;
  const usual = [bench.aim.signal, bench.aim.reference, "force", "current"].filter((name) => columnOf(bench, name) >= 0);
  let names = settings.signals ?? usual;
  const body = make("tbody");
  const heads = ["Signal", "Now", "Mean", "Rms about mean", "Peak to peak"];
  const head = make("tr", {}, ...heads.map((text) => make("th", { textContent: text, scope: "col" })));
  const include = (name) => keep([...new Set([...names, name])]);
  const add = signalChoice(bench, "", "add a signal to the table", {
    onchange: () => {
      include(add.value);
      add.choose("");
    },
  });
  const row = (name) => {
    const signal = signalOf(bench, name);
    const remove = make("button", { className: "small", textContent: "×", onclick: () => keep(names.filter((one) => one !== name)) });
    remove.ariaLabel = `remove ${signal.label}`;
    const cells = heads.slice(1).map(() => make("td"));
    return make("tr", {}, make("th", { textContent: signal.label, title: hint(signal), scope: "row" }), ...cells, make("td", {}, remove));
  };
  let listed = null; // signals of the bench for which the rows were made
  const keep = (wanted) => {
    names = wanted;
    listed = null;
    save({ signals: names });
  };
  const draw = paced(() => {
    const signals = names.map((name) => signalOf(bench, name)).filter(Boolean);
    if (listed !== bench.signals) body.replaceChildren(...signals.map(({ name }) => row(name)));
    listed = bench.signals;
    for (const [n, signal] of signals.entries()) {
      const { now, mean, rms, low, high } = statistics(context, signal.column);
      const texts = [reading(signal, now, 4), ...[mean, rms, high - low].map((value) => show(value, signal.unit, 4))];
      for (const [m, text] of texts.entries()) body.rows[n].cells[m + 1].textContent = text;
    }
  }, 250);
  const element = make("div", { className: "scroll", tabIndex: 0, role: "region", ariaLabel: "table of signals" }, make("table", {}, make("thead", {}, head), body));
  return { element, tools: [add], draw, drop: include };
}
