// The frequency response panel: measures closed loop, sensitivity and plant while the rig runs, and reads off margins.

import { Plane, limits } from "./canvas.js";
import { COLOURS, ink } from "./colours.js";
import { download, field, make, refuse, select } from "./dom.js";
import { Quantity } from "./quantity.js";

const CURVES = { closed_loop: ["Closed loop", COLOURS[0]], sensitivity: ["Sensitivity", COLOURS[1]], plant: ["Plant", COLOURS[2]] };
const CHOICES = { loop: ["closed_loop", "sensitivity"], plant: ["plant"] };
const ZONES = [["A", 3], ["B", 4], ["C", 5]]; // largest peak of the sensitivity in each zone of ISO 14839-3
const ZONE_TEXT_DB = 4; // room for the names of the zones above the highest limit
const MAX_FINE_PHASE_DEG = 540; // largest range of phase with a label at each 90 degrees
const MIN_MOTION_PART = 1e-3; // smallest motion, relative to the largest
const WITHOUT_PORT = "This rig cannot add a signal to its position reading, so its frequency response cannot be measured.";
const EMPTY = "No frequency response yet. Lift the body, wait until it rests, and press Measure: a signal of 18 s measures 200 points from 1 Hz to 5 kHz.";

export class BodePanel {
  #key = ""; // what the planes show
  #cursor = null; // logarithm of the frequency of the cursor
  #results = []; // the last two results, newest first

  constructor({ bench, order }, settings, save) {
    Object.assign(this, { bench, order, chosen: settings.shown ?? "loop" });
    const most = bench.response?.max_motion ?? 1e-6;
    const spec = { label: "Largest motion", unit: "m", low: MIN_MOTION_PART * most, high: most, value: settings.motion ?? most };
    this.motion = new Quantity(spec, () => save(this.#settings()), () => this.#press());
    const names = [["loop", "Closed loop and sensitivity"], ["plant", "Plant"]];
    this.choice = select(names, this.chosen);
    this.choice.onchange = () => {
      this.chosen = this.choice.value;
      save(this.#settings());
    };
    this.button = make("button", { className: "primary", id: "measure-response", textContent: "Measure", onclick: () => this.#press() });
    this.button.title = "Add a small signal to the position reading, and measure the response of the loop";
    this.csv = make("button", { textContent: "Save CSV", title: "Save the response; anhyst_rigs.read_response reads the file", onclick: () => this.#save() });
    this.progress = make("progress", { max: 1, value: 0, hidden: true });
    this.progress.setAttribute("aria-label", "progress of the measurement");
    this.tools = [field("Largest motion", this.motion.input, this.motion.unit), this.motion.message, this.button, this.progress, field("Show", this.choice), this.csv];
    this.note = make("p", { className: "empty", role: "status" });
    this.figures = make("dl", { className: "dials small-dials" });
    this.reading = make("output", { className: "reading" });
    this.planes = ["Magnitude / dB", "Phase / °", "Coherence"].map((label) => this.#plane(label));
    const parts = [this.figures, this.reading, ...this.planes.map((plane) => plane.canvas.parentElement)];
    this.element = make("div", { className: "bode" }, this.note, ...parts);
    this.#fill();
  }

  #settings() {
    return { shown: this.chosen, motion: this.motion.value ?? undefined };
  }

  #plane(label) {
    const figure = make("figure");
    const plane = new Plane(figure, "Frequency / Hz", label, "x");
    plane.onCursor((x) => (this.#cursor = x));
    return plane;
  }

  #press() {
    if (this.running) this.order("response", { cancel: true });
    else if (!this.button.disabled && this.motion.check()) this.order("response", { motion: this.motion.value });
  }

  #save() {
    const name = `${this.bench.title.replace(/\W+/g, "-")}-response.csv`;
    download(name, new Blob([this.#results[0].csv], { type: "text/csv" }));
  }

  status({ response, refused }) {
    const { bench, button } = this;
    this.running = response.running;
    button.textContent = this.running ? "Cancel" : "Measure";
    button.classList.toggle("primary", !this.running);
    refuse(button, this.running ? "" : (refused.response ?? ""));
    refuse(this.csv, this.#results.length ? "" : "Nothing is measured yet");
    this.progress.hidden = !this.running;
    this.progress.value = response.share;
    if (bench.measured && bench.measured !== this.#results[0]) {
      this.#results = [bench.measured, ...this.#results].slice(0, 2);
      this.#fill();
    }
    const trouble = response.trouble && `The last measurement gave no result. ${response.trouble}`;
    const wait = this.running ? `Measuring: ${Math.round(100 * response.share)} %. STOP and Cancel end the measurement.` : "";
    const hint = this.#results.length ? "" : refused.response ? `${EMPTY} Now: ${refused.response}.` : EMPTY;
    const text = bench.response ? wait || trouble || hint : WITHOUT_PORT;
    if (this.note.textContent !== text) this.note.textContent = text;
    this.note.hidden = !text;
  }

  // Shows margins and zone of the newest result.
  #fill() {
    const [result] = this.#results;
    for (const plane of this.planes) plane.canvas.parentElement.hidden = !result;
    this.figures.replaceChildren(...(result ? readings(result) : []).map(([name, text]) => make("div", {}, make("dt", { textContent: name }), make("dd", { textContent: text }))));
    this.#key = "";
  }

  draw() {
    const [result, previous] = this.#results;
    if (!result) return;
    const { clientWidth, clientHeight } = this.planes[0].canvas.parentElement;
    const key = [this.chosen, clientWidth, clientHeight, document.documentElement.dataset.theme, this.#cursor].join();
    if (key === this.#key || !clientWidth) return;
    this.#key = key;
    const names = CHOICES[this.chosen];
    const xs = result.columns.frequency_Hz.map(Math.log10);
    const curves = names.map((name) => curveOf(result, name));
    const kinds = ["decibel", "phase", "coherence"];
    for (const [n, kind] of kinds.entries()) {
      const plane = this.planes[n];
      const shown = curves.map((curve) => curve[kind].filter((value) => value !== null));
      const zones = kind === "decibel" && names.includes("sensitivity") ? ZONES.map(([, peak]) => decibel(peak)) : [];
      const [low, high] = kind === "coherence" ? [0, 1.05] : kind === "phase" ? rightAngles(limits(...shown)) : limits(...shown, zones, zones.slice(-1).map((level) => level + ZONE_TEXT_DB));
      if (kind === "decibel") plane.labels[1] = `Magnitude / dB${curves[0].reference}`;
      if (kind === "phase") plane.yStep = high - low > MAX_FINE_PHASE_DEG ? 180 : 90;
      plane.begin([xs[0], xs.at(-1), low, high]);
      for (const level of zones) plane.line([xs[0], xs.at(-1)], [level, level], ink("--soft"), 1, 0.6);
      if (zones.length) labelZones(plane, xs[0]);
      if (previous) {
        const old = previous.columns.frequency_Hz.map(Math.log10);
        for (const name of names) drawCurve(plane, old, curveOf(previous, name), kind, CURVES[name][1], 0.35);
      }
      for (const [m, curve] of curves.entries()) drawCurve(plane, xs, curve, kind, CURVES[names[m]][1], 1);
      if (this.#cursor !== null) plane.line([xs[nearest(xs, this.#cursor)], xs[nearest(xs, this.#cursor)]], [low, high], ink("--ink"), 1, 0.5);
    }
    this.#read(xs, names, curves);
  }

  // Writes the legend, or the values at the cursor.
  #read(xs, names, curves) {
    const at = this.#cursor === null ? -1 : nearest(xs, this.#cursor);
    const frequency = at < 0 ? "" : `${rounded(10 ** xs[at])} Hz`;
    const parts = names.map((name, n) => {
      const swatch = make("span", { className: "swatch" });
      swatch.style.background = CURVES[name][1];
      return make("span", { className: "key" }, swatch, `${CURVES[name][0]}${at < 0 ? "" : `: ${valueText(curves[n], at)}`}`);
    });
    const older = this.#results.length > 1 ? ["pale: the measurement before"] : [];
    this.reading.replaceChildren(...[frequency, ...parts, ...older].flatMap((part) => [part, "   "]));
  }

  table() {
    return this.#results[0]?.columns ?? { frequency_Hz: [] };
  }

  words() {
    const [result] = this.#results;
    const legend = CHOICES[this.chosen].map((name) => CURVES[name]);
    return result ? [readings(result).map(([name, text]) => [`${name}: ${text}`]), legend] : [];
  }
}

// Returns a range of phase that is extended to multiples of 90 degrees.
const rightAngles = ([low, high]) => [90 * Math.floor(low / 90), 90 * Math.ceil(high / 90)];
const decibel = (factor) => 20 * Math.log10(factor);
const rounded = (value, digits = 4) => String(Number(value.toPrecision(digits)));

// Returns what the margins say, as [name, text].
function readings({ margins, zone, facts }) {
  const text = (value, digits = 3) => (value === null ? "not found" : rounded(value, digits));
  const exact = Object.entries(facts).find(([name]) => name.startsWith("points"));
  return [
    ["Sensitivity peak", `${text(margins.peak)} (${decibel(margins.peak).toFixed(1)} dB) at ${text(margins.peak_frequency)} Hz`],
    ["ISO 14839-3", `Zone ${zone}`],
    ["Modulus margin", text(margins.modulus)],
    ["Phase margin", margins.phase === null ? "not found" : `${text(margins.phase)}° at ${text(margins.crossover)} Hz`],
    ["Gain margins", `× ${text(margins.gain_down)}, × ${text(margins.gain_up)}`],
    [`P${exact[0].slice(1)}`, exact[1]],
  ];
}

// Returns the lines of a response; null where it has no value.
function curveOf({ columns, plant_unit: unit }, name) {
  const key = name === "plant" ? `plant_${unit.replace("/", "_per_")}` : name;
  return {
    reference: name === "plant" ? ` re 1 ${unit}` : "",
    decibel: columns[key].map((value) => (value === null ? null : decibel(value))),
    phase: columns[`${name}_deg`],
    coherence: columns[`${name}_coherence`],
    uncertainty: columns[`${name}_uncertainty_dB`],
  };
}

// Draws a curve with gaps where it has no value, and the band of its uncertainty.
function drawCurve(plane, xs, curve, kind, colour, alpha) {
  const ys = curve[kind];
  for (let first = 0; first < xs.length; first++) {
    if (ys[first] === null) continue;
    let end = first;
    while (end < xs.length && ys[end] !== null) end++;
    const [x, y] = [xs.slice(first, end), ys.slice(first, end)];
    const spread = curve.uncertainty.slice(first, end);
    if (kind === "decibel" && alpha === 1) plane.band(x, y.map((one, n) => one - spread[n]), y.map((one, n) => one + spread[n]), colour, 0.25);
    plane.line(x, y, colour, 1.5, alpha);
    first = end;
  }
}

function labelZones(plane, left) {
  const { context } = plane;
  context.font = "12px system-ui, sans-serif";
  context.fillStyle = ink("--soft");
  context.textAlign = "left";
  const names = ZONES.map(([name, peak]) => `${name} < ${decibel(peak).toFixed(1)} dB`);
  context.fillText(`ISO 14839-3: ${names.join(", ")}`, plane.x(left) + 4, plane.y(decibel(ZONES.at(-1)[1])) - 4);
}

function nearest(xs, x) {
  let best = 0;
  for (let n = 1; n < xs.length; n++) if (Math.abs(xs[n] - x) < Math.abs(xs[best] - x)) best = n;
  return best;
}

function valueText({ reference, decibel: size, phase, coherence, uncertainty }, at) {
  const low = `coherence ${coherence[at].toFixed(3)}`;
  if (size[at] === null) return `no value, ${low} is too low`;
  return `${size[at].toFixed(1)} ± ${uncertainty[at].toFixed(1)} dB${reference}, ${phase[at].toFixed(1)}°, ${low}`;
}
