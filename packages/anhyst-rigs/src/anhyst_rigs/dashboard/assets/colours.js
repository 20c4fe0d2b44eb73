// Colours of signals, and those of the theme.

// Okabe-Ito colours, which all kinds of colour vision can distinguish, on white and on black.
export const COLOURS = [
  "#0072b2",
  "#d55e00",
  "#009e73",
  "#cc79a7",
  "#e69f00",
  "#56b4e9",
  "#8c8c8c",
  "#b8a800",
];

const known = new Map();

// Returns a colour of the active theme. Colours are cached, because the browser computes them slowly.
export function ink(name) {
  const root = document.documentElement;
  const key = `${root.dataset.theme} ${name}`;
  if (!known.has(key)) known.set(key, getComputedStyle(root).getPropertyValue(name).trim());
  return known.get(key);
}
