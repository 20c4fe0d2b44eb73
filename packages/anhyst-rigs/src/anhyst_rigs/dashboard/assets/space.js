// Draws objects in space on a canvas in parallel projection. Mouse, touch or arrow keys rotate it.

import { ink } from "./colours.js";

const VIEW = { round: -1.05, up: 0.42 }; // initial view angles, rad: x points to the right, z upwards
const KEY_ROTATION = 0.08; // rotation per key press, rad
const DRAG_ROTATION = 0.008; // rotation per pixel, rad
const ARROW_HEAD_PX = 9; // length of an arrow head, pixels

export class Space {
  view = { ...VIEW };

  constructor(place, label) {
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.className = "space";
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    this.context = this.canvas.getContext("2d");
    place.append(this.canvas);
    this.#turnable();
  }

  #turnable() {
    const { canvas } = this;
    canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
    canvas.onpointermove = (event) => {
      if (event.buttons) this.turn(-DRAG_ROTATION * event.movementX, DRAG_ROTATION * event.movementY);
    };
    canvas.ondblclick = () => (this.view = { ...VIEW });
    const keys = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    canvas.onkeydown = (event) => {
      if (event.key === "Home") this.view = { ...VIEW };
      else if (keys[event.key]) this.turn(...keys[event.key].map((way) => KEY_ROTATION * way));
      else return;
      event.preventDefault();
    };
  }

  turn(round, up) {
    const most = Math.PI / 2;
    this.view.round += round;
    this.view.up = Math.max(-most, Math.min(most, this.view.up + up));
  }

  // Starts a picture that shows everything within a radius of a centre point.
  begin(middle, radius) {
    const { canvas, context } = this;
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    const ratio = devicePixelRatio;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    context.lineJoin = "round";
    const [s, c] = [Math.sin(this.view.round), Math.cos(this.view.round)];
    const [su, cu] = [Math.sin(this.view.up), Math.cos(this.view.up)];
    this.towards = [cu * c, cu * s, su]; // direction towards the viewer
    const scale = (this.scale = Math.min(width, height) / (2 * radius)); // pixels per metre
    this.at = (point) => {
      const [x, y, z] = point.map((one, n) => one - middle[n]);
      const right = -s * x + c * y;
      const above = -su * c * x - su * s * y + cu * z;
      return [width / 2 + scale * right, height / 2 - scale * above];
    };
  }

  // Whether a direction points towards the viewer.
  faces(direction) {
    return direction.reduce((sum, one, n) => sum + one * this.towards[n], 0) > 0;
  }

  line(points, colour, width = 1, dash = []) {
    const { context } = this;
    context.beginPath();
    for (const point of points) context.lineTo(...this.at(point));
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  face(points, colour, alpha) {
    const { context } = this;
    context.beginPath();
    for (const point of points) context.lineTo(...this.at(point));
    context.closePath();
    context.fillStyle = colour;
    context.globalAlpha = alpha;
    context.fill();
    context.globalAlpha = 1;
  }

  arrow(from, to, colour, width = 3) {
    const { context } = this;
    const [[x0, y0], [x, y]] = [this.at(from), this.at(to)];
    const long = Math.hypot(x - x0, y - y0);
    this.line([from, to], colour, width);
    if (long < 1) return;
    const head = Math.min(ARROW_HEAD_PX, long);
    const [a, b] = [(head * (x - x0)) / long, (head * (y - y0)) / long];
    context.beginPath();
    context.moveTo(x + 0.3 * a, y + 0.3 * b);
    context.lineTo(x - a - 0.5 * b, y - b + 0.5 * a);
    context.lineTo(x - a + 0.5 * b, y - b - 0.5 * a);
    context.fillStyle = colour;
    context.fill();
  }

  text(words, point, colour = ink("--ink")) {
    const [x, y] = this.at(point);
    this.context.textAlign = "center";
    this.context.fillStyle = colour;
    this.context.fillText(words, x, y + 4);
  }

  // Writes line n of the text, counted from the lower left corner upwards, after a bar of `bar` pixels.
  note(words, n, bar = 0, colour = ink("--ink")) {
    const { context } = this;
    const y = this.canvas.parentElement.clientHeight - 12 - 18 * n;
    context.fillStyle = colour;
    context.fillRect(10, y - 5, bar, 3);
    context.textAlign = "left";
    context.fillStyle = ink("--ink");
    context.fillText(words, bar ? 18 + bar : 10, y);
  }
}
