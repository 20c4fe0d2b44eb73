// Colours of signals, and those of the theme.

// The palette of all figures: figures.py defines it, and states why all kinds of colour vision can distinguish it.
export const COLOURS = [
  "#0072b2",
  "#d55e00",
  "#009e73",
  "#cc79a7",
  "#e69f00",
  "#56b4e9",
  "#486060",
  "#903018",
];
export const [BLUE, VERMILION, GREEN] = COLOURS;

// Dashes of a line, in pixels along the time axis: [period, drawn part]. The first colours are solid.
const DASHES = [null, [14, 9], [6, 3]];

// Signals that are often drawn together receive different colours first.
const OFTEN_DRAWN = ["force", "current", "voltage", "demand", "gap_read", "velocity", "expected", "load"];

// Returns the line of each signal of a bench, by name: a colour and dashes that no other of its first
// 24 signals has. The line depends only on the bench, so that it is the same in every view and browser.
export function lines({ aim, signals }) {
  const names = new Set([aim.signal, aim.reference, "error", ...OFTEN_DRAWN, ...signals.map((one) => one.name)]);
  const known = new Set(signals.map((one) => one.name));
  const ordered = [...names].filter((name) => known.has(name));
  return new Map(
    ordered.map((name, n) => [
      name,
      { colour: COLOURS[n % COLOURS.length], dash: DASHES[Math.floor(n / COLOURS.length) % DASHES.length] },
    ]),
  );
}

const known = new Map();

// Returns a colour of the active theme. Colours are cached, because the browser computes them slowly.
export function ink(name) {
  const root = document.documentElement;
  const key = `${root.dataset.theme} ${name}`;
  if (!known.has(key)) known.set(key, getComputedStyle(root).getPropertyValue(name).trim());
  return known.get(key);
}
