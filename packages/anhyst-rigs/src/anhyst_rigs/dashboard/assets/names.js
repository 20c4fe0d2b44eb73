// Readable names and symbols of signals and parameters. The identifier remains the key everywhere.

import { make } from "./dom.js";

// Name and symbol by identifier. An identifier with its unit has priority: `demand N`.
const WORDS = {
  gap: ["Gap", "g"],
  position: ["Position", "x"],
  velocity: ["Velocity", "v"],
  reference: ["Reference", "r"],
  error: ["Error", "e"],
  demand: ["Demand", "x*"],
  "demand N": ["Force demand", "F*"],
  force: ["Force", "F"],
  load: ["Load force", "F_L"],
  command: ["Current command", "i*"],
  current: ["Current", "i"],
  voltage: ["Voltage", "u"],
  flux: ["Flux linkage", "ψ"],
  flux_density: ["Flux density", "B"],
  expected: ["Expected position", "x̂"],
  "expected N": ["Model force", "F̂"],
  model_flux: ["Model flux", "φ̂"],
  disturbance: ["Disturbance", "d"],
  pull: ["Pull", "F"],
  "wrench N": ["Force", "F"],
  "wrench N_m": ["Moment", "M"],
  "demand N_m": ["Moment demand", "M*"],
  lap: ["Cycle", ""],
  flight: ["Flight phase", ""],
  gain_p: ["Proportional gain", "K_p"],
  gain_i: ["Integral gain", "K_i"],
  gain_d: ["Derivative gain", "K_d"],
  gain_dd: ["Second derivative gain", "K_dd"],
};

// Parts that follow the identifier of a quantity: measured, a coordinate, the number of a magnet.
const MEASURED = /_read$/;
const INDEX = /_(r?[xyz]|\d+)$/;

let isOurs = true; // whether identifiers have the meanings of WORDS

// Sets whether identifiers have our meanings; those of a foreign firmware are shown as they are.
export function chooseNames({ catalogue }) {
  isOurs = !catalogue;
}

// Returns the name of the value that the user demands of a bench.
export const aimName = ({ aim }) => (aim.is_offset ? "Offset of the motion" : "Target");

// Returns the readable name and the symbol of a signal or parameter.
export function describe({ name, unit }) {
  if (!isOurs) return { label: name, symbol: "" };
  let base = name;
  const take = (pattern) => {
    const found = pattern.exec(base);
    if (found) base = base.slice(0, found.index);
    return found;
  };
  let index = take(INDEX)?.[1] ?? "";
  const measured = take(MEASURED) !== null;
  index ||= take(INDEX)?.[1] ?? "";
  const known = WORDS[`${base} ${unit}`] ?? WORDS[base];
  const [label, symbol] = known ?? [words(base), ""];
  return {
    label: [measured ? `Measured ${label.toLowerCase()}` : label, index].filter(Boolean).join(" "),
    symbol: symbol && symbol + (index && `_${index}`) + (measured ? "_m" : ""),
  };
}

// Returns an identifier as words with a capital letter.
export function words(identifier) {
  const text = identifier.replace(/[._]+/g, " ").trim();
  return text.charAt(0).toUpperCase() + text.slice(1);
}

// Returns a symbol as an element, with its indices as a subscript.
export function sign(symbol) {
  const [base, ...indices] = symbol.split("_");
  return make("i", { className: "sign", textContent: symbol && ` ${base}` }, make("sub", { textContent: indices.join(",") }));
}

// Names of the quantities on the axes, by SI unit.
const QUANTITIES = {
  m: "Length",
  rad: "Angle",
  "m/s": "Velocity",
  N: "Force",
  N_m: "Moment",
  A: "Current",
  V: "Voltage",
  Wb: "Flux linkage",
  T: "Flux density",
};

// Returns the text at an axis: the signals if they are few, otherwise their quantity.
export function axisName(signals, unit) {
  if (signals.length === 1 || signals.length === 2) return signals.map((one) => one.label).join(", ");
  return QUANTITIES[unit] ?? "Value";
}
