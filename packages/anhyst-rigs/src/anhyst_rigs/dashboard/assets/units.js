// Units for the display. Values arrive in SI units.

// Name, factor from SI, and minimum range of an axis, so that noise at standstill remains small.
const SHOWN = {
  m: ["µm", 1e6, 0.02],
  rad: ["µrad", 1e6, 0.02],
  "m/s": ["mm/s", 1e3, 0.01],
  N: ["N", 1, 0.1],
  N_m: ["N m", 1, 0.01],
  A: ["A", 1, 1e-3],
  V: ["V", 1, 0.1],
  Wb: ["mWb", 1e3, 0.01],
  T: ["T", 1, 1e-3],
};

const STEPS_PER_LEAST = 100; // values are rounded to such a part of the minimum range

// Whether signals and parameters with a unit are always shown in the same multiple of it.
export const isUsual = (unit) => unit in SHOWN;

export function shown(unit) {
  const [name, factor, least] = SHOWN[unit] ?? [unit, 1, 1];
  return { name, factor, least };
}

// Units for quantities that are much smaller than the signal: noise and deviations.
const FINE = { m: ["nm", 1e9], rad: ["nrad", 1e9], N: ["mN", 1e3], A: ["mA", 1e3] };

export function fine(unit) {
  const [name, factor] = FINE[unit] ?? [unit, 1];
  return { name, factor };
}

export function show(value, unit, digits = 5) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const { name, factor } = shown(unit);
  const resolution = SHOWN[unit] ? SHOWN[unit][2] / STEPS_PER_LEAST : 0;
  const size = value * factor;
  const rounded = resolution ? Math.round(size / resolution) * resolution : size;
  return `${Number(rounded.toPrecision(digits))}${name ? ` ${name}` : ""}`;
}

// Returns a fraction of the demand range, rounded down to 1, 2 or 5 times a power of ten.
export function usual({ low, high, unit }, part) {
  const wanted = part * (high - low) * shown(unit).factor;
  const power = 10 ** Math.floor(Math.log10(wanted));
  return Number((power * [5, 2, 1].find((one) => one * power <= wanted)).toPrecision(1));
}

export function seconds(value) {
  const size = Math.abs(value);
  if (size < 1e-3) return `${Number((value * 1e6).toPrecision(4))} µs`;
  if (size < 1) return `${Number((value * 1e3).toPrecision(4))} ms`;
  return `${Number(value.toPrecision(6))} s`;
}
