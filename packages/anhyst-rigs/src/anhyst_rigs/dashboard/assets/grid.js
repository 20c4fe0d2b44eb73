// Places panels on a grid of 12 columns: a moved panel keeps its place, and others give way.

export const COLUMNS = 12;
const MIN_SIZE = 2; // smallest width and height of a panel, cells

// Limits the place of a panel {x, y, w, h} to the grid.
export function limited({ x, y, w, h }) {
  const width = Math.min(COLUMNS, Math.max(MIN_SIZE, w));
  return {
    w: width,
    h: Math.max(MIN_SIZE, h),
    x: Math.min(COLUMNS - width, Math.max(0, x)),
    y: Math.max(0, y),
  };
}

// Moves all other panels down until none overlaps, then moves every panel up into free rows.
export function settle(panels, moved = null) {
  const order = panels.toSorted((a, b) => (a === moved ? -1 : b === moved ? 1 : a.y - b.y || a.x - b.x));
  const placed = [];
  for (const panel of order) {
    while (placed.some((other) => overlap(panel, other))) panel.y++;
    placed.push(panel);
  }
  for (const panel of placed.toSorted((a, b) => a.y - b.y)) {
    const others = placed.filter((other) => other !== panel);
    while (panel.y > 0 && !others.some((other) => overlap({ ...panel, y: panel.y - 1 }, other))) panel.y--;
  }
}

// Returns the first place for a panel of a size [w, h].
export function free(panels, [w, h]) {
  for (let y = 0; ; y++) {
    for (let x = 0; x + w <= COLUMNS; x++) {
      const place = { x, y, w, h };
      if (!panels.some((other) => overlap(place, other))) return place;
    }
  }
}

function overlap(a, b) {
  return a.x < b.x + b.w && b.x < a.x + a.w && a.y < b.y + b.h && b.y < a.y + a.h;
}
