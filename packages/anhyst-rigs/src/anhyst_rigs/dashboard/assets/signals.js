// The signals of the bench: their columns, readable names, lines and noise.

import { lines } from "./colours.js";
import { make } from "./dom.js";
import { chooseNames, describe } from "./names.js";
import { show, shown } from "./units.js";

// Returns the column of a signal, or -1 if it does not exist.
export function columnOf(bench, name) {
  return bench.signals.findIndex((signal) => signal.name === name);
}

// Returns a signal, or undefined if it does not exist.
export function signalOf(bench, name) {
  return bench.signals[columnOf(bench, name)];
}

export const NO_SIGNAL = "This signal does not exist any more; choose another.";

// Returns a selection of a signal. `choose` selects one, and lists the signals again: also without a name, after a
// derived signal was defined or deleted.
export function signalChoice(bench, name, ariaLabel, properties = {}) {
  const element = make("select", { className: "signalchoice", ariaLabel, ...properties });
  let chosen = name;
  element.addEventListener("change", () => (chosen = element.value));
  element.choose = (wanted = chosen) => {
    chosen = wanted;
    const none = chosen ? [] : [make("option", { value: "", textContent: "Choose a signal" })];
    element.replaceChildren(...none, ...bench.signals.map((one) => make("option", { value: one.name, textContent: one.label })));
    element.value = chosen;
  };
  element.choose();
  return element;
}

// Returns the column of the phase of a levitated body, or -1 if no body levitates.
export const phaseColumn = (bench) => Math.max(columnOf(bench, "phase"), columnOf(bench, "flight"));

// Adds the column, the readable name, the symbol, the line and the names of its values to each signal of a bench.
export function label(bench) {
  chooseNames(bench);
  const styles = lines(bench);
  for (const [column, signal] of bench.signals.entries())
    Object.assign(signal, { column, values: bench.catalogue ? null : NAMED[signal.name]?.(bench), ...describe(signal), ...styles.get(signal.name) });
}

// The names of the values of a signal that is a number of a state.
const NAMED = {
  state: ({ states }) => states,
  phase: ({ phases }) => phases,
  flight: ({ phases }) => phases,
  fault: ({ faults }) => faults,
};

// Returns a value of a signal with its unit, or its name.
export function reading({ unit, values }, value, digits) {
  return values?.[value] ?? show(value, unit, digits);
}

// Returns the text that a signal shows on hover.
export function hint({ name, label, symbol, unit, doc }) {
  return `${label}${symbol && `, ${symbol}`}${unit && `, ${shown(unit).name}`}\n${name}${doc && `: ${doc}`}`;
}

const NOISE_ROWS = 400; // number of rows from which the noise is estimated
const SPAN_PER_NOISE = 30; // smallest range of an axis, in standard deviations of the noise
const SPAN_PER_RANGE = 0.005; // smallest range of an axis as a fraction of the demand range

const SPAN_MS = 1000; // time for which an estimate of the noise is valid
const spans = new Map(); // smallest range and its end of validity by unit

// Returns the smallest range of an axis with a unit, SI, so that noise remains a thin line.
export function leastSpan(bench, store, unit) {
  const now = performance.now();
  const known = spans.get(unit);
  if (known && now < known.due) return known.span;
  const span = estimateSpan(bench, store, unit);
  spans.set(unit, { span, due: now + SPAN_MS });
  return span;
}

function estimateSpan(bench, store, unit) {
  const { least, factor } = shown(unit);
  const range = unit === bench.aim.unit ? SPAN_PER_RANGE * (bench.aim.high - bench.aim.low) : 0;
  const read = bench.signals.filter((one) => one.unit === unit && one.name.includes("_read"));
  const noises = read.slice(0, 4).map((one) => noise(store, one.column));
  return Math.max(least / factor, range, SPAN_PER_NOISE * Math.max(0, ...noises));
}

// Returns the standard deviation of the noise of a column. Differences between successive rows contain the noise,
// and their median is not changed by a slow motion.
function noise(store, column) {
  const steps = [];
  for (let row = Math.max(1, store.count - NOISE_ROWS); row < store.count; row++) {
    const step = Math.abs(store.value(column, row) - store.value(column, row - 1));
    if (step === step) steps.push(step);
  }
  steps.sort((a, b) => a - b);
  return steps.length ? steps[steps.length >> 1] / (0.6745 * Math.SQRT2) : 0;
}
