// Saves the open view as a picture or as a table.

import { ink } from "./colours.js";

const MARGIN_PX = 12; // margin around the picture, pixels
const LINE_HEIGHT_PX = 18; // distance between two lines of text, pixels
const FONT = "13px system-ui, sans-serif";

// Makes a PNG of all canvases of a view, below header lines of [text, colour] parts.
export function picture(view, parts) {
  const drawn = [...view.querySelectorAll("canvas")].filter((one) => one.clientWidth > 0);
  const boxes = drawn.map((one) => one.getBoundingClientRect());
  const left = Math.min(...boxes.map((box) => box.left)) - MARGIN_PX;
  const right = Math.max(...boxes.map((box) => box.right)) + MARGIN_PX;
  const lines = wrapped(parts, right - left - 2 * MARGIN_PX);
  const top = Math.min(...boxes.map((box) => box.top)) - MARGIN_PX - LINE_HEIGHT_PX * lines.length - MARGIN_PX;
  const bottom = Math.max(...boxes.map((box) => box.bottom)) + MARGIN_PX;
  const canvas = document.createElement("canvas");
  canvas.width = Math.ceil((right - left) * devicePixelRatio);
  canvas.height = Math.ceil((bottom - top) * devicePixelRatio);
  const context = canvas.getContext("2d");
  context.scale(devicePixelRatio, devicePixelRatio);
  context.fillStyle = ink("--paper");
  context.fillRect(0, 0, right - left, bottom - top);
  for (const [n, one] of drawn.entries()) {
    const { x, y, width, height } = boxes[n];
    context.drawImage(one, x - left, y - top, width, height);
  }
  for (const [n, line] of lines.entries()) write(context, line, MARGIN_PX + LINE_HEIGHT_PX * (n + 0.7));
  return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
}

// Breaks lines between their parts, so that each fits into a width, pixels.
function wrapped(lines, width) {
  const context = document.createElement("canvas").getContext("2d");
  context.font = FONT;
  const found = [];
  for (const line of lines) {
    let used = Infinity;
    for (const part of line) {
      const needed = context.measureText(part[0]).width + MARGIN_PX;
      if (used + needed - MARGIN_PX > width) {
        found.push([]);
        used = 0;
      }
      found.at(-1).push(part);
      used += needed;
    }
  }
  return found;
}

function write(context, line, y) {
  context.font = FONT;
  let x = MARGIN_PX;
  for (const [text, colour] of line) {
    context.fillStyle = colour ?? ink("--ink");
    context.fillText(text, x, y);
    x += context.measureText(text).width + MARGIN_PX;
  }
}

// Returns columns with their headers as CSV.
export function csv(columns) {
  const heads = Object.keys(columns);
  const cell = (value) => (String(value).includes(",") ? `"${value}"` : value);
  const rows = Array.from(columns[heads[0]], (_, n) => heads.map((head) => cell(columns[head][n])).join());
  return `${[heads.join(), ...rows].join("\n")}\n`;
}
