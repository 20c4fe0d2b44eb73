// Saves the open view as a picture or as a table.

import { ink } from "./colours.js";

const MARGIN_PX = 12; // margin around the picture, pixels
const LINE_HEIGHT_PX = 18; // distance between two lines of text, pixels

// Makes a PNG of all canvases of a view, below header lines of [text, colour] parts.
export function picture(view, lines) {
  const drawn = [...view.querySelectorAll("canvas")].filter((one) => one.clientWidth > 0);
  const boxes = drawn.map((one) => one.getBoundingClientRect());
  const left = Math.min(...boxes.map((box) => box.left)) - MARGIN_PX;
  const top = Math.min(...boxes.map((box) => box.top)) - MARGIN_PX - LINE_HEIGHT_PX * lines.length - MARGIN_PX;
  const right = Math.max(...boxes.map((box) => box.right)) + MARGIN_PX;
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

function write(context, line, y) {
  context.font = "13px system-ui, sans-serif";
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
