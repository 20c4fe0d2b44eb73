// Finds steps of the reference in the samples, and computes overshoot, rise and settling times.

import { COLOURS } from "./colours.js";

const MAX_STEPS = 12; // number of steps that are kept of each setting
const NOISE_DEVIATIONS = 4; // noise before a step, in standard deviations
const BEFORE_S = 0.01; // time for which the reference must be constant before a step
const NOISE_S = 0.05; // longest time before a step from which the noise is found
export const AFTER_S = 0.06; // time for which it must be constant after a step
const MIN_HEIGHT_RATIO = 1e-3; // smallest height of a step, as a fraction of the reference before it
const BAND = 0.05; // settling band, as a fraction of the step height

export class StepFinder {
  steps = []; // the last steps of each setting; a new array after each change
  settings = []; // labels of their parameters; the number of a setting is its colour, so it never changes

  #rate; // rows per second
  #every; // ticks between two rows
  #columns;
  #rows = []; // recent rows: [tick, reference, actual]
  #since = 0; // rows since the reference last changed
  #jump = null; // row of a step that has not settled yet; null if there is none
  #rested = 0; // rows with a constant reference before this step, from which the noise is found

  // `inForce` returns a text on the parameters that are active at a tick.
  constructor({ rate, every }, reference, actual, inForce) {
    this.#rate = rate / every;
    this.#every = every;
    this.#columns = [reference, actual];
    this.inForce = inForce;
  }

  // Adds the steps that ended within a frame.
  feed(frame) {
    if (frame.thinned) return this.#reset();
    const [references, actuals] = this.#columns.map((n) => frame.data[n]);
    for (let i = 0; i < frame.ticks.length; i++) {
      const step = this.#row(frame.ticks[i], references[i], actuals[i]);
      if (step) this.#add({ ...step, label: this.inForce(step.tick) });
    }
  }

  clear() {
    this.steps = [];
    this.settings = [];
  }

  // Adds a step; drops the first step of its setting if they are too many, and the setting without a step for the
  // longest time if there is no colour for a new one.
  #add(step) {
    const latest = (label) => this.steps.findLast((one) => one.label === label).tick;
    const { settings } = this;
    if (!settings.includes(step.label)) {
      const oldest = settings.toSorted((a, b) => latest(a) - latest(b))[0];
      const place = settings.length < COLOURS.length ? settings.length : settings.indexOf(oldest);
      this.steps = this.steps.filter((one) => one.label !== settings[place]);
      settings[place] = step.label;
    }
    const same = this.steps.filter((one) => one.label === step.label);
    const dropped = same.length < MAX_STEPS ? null : same[0];
    this.steps = [...this.steps.filter((one) => one !== dropped), step];
  }

  #reset() {
    this.#rows = [];
    this.#since = 0;
    this.#jump = null;
  }

  // Returns the number of rows before a step in which the quantity had time to settle after the step before.
  #restRows() {
    const settled = this.#since - AFTER_S * this.#rate;
    return Math.round(Math.max(BEFORE_S * this.#rate, Math.min(settled, NOISE_S * this.#rate)));
  }

  #row(tick, reference, actual) {
    const rows = this.#rows;
    const last = rows.at(-1);
    if (last && tick !== last[0] + this.#every) this.#reset();
    if (last && reference !== last[1]) {
      const rested = this.#since >= BEFORE_S * this.#rate;
      const high = Math.abs(reference - last[1]) > MIN_HEIGHT_RATIO * Math.abs(last[1]);
      this.#jump = rested && high ? rows.length : null;
      this.#rested = Math.min(rows.length, this.#restRows());
      this.#since = 0;
    } else this.#since++;
    rows.push([tick, reference, actual]);
    const kept = Math.round(NOISE_S * this.#rate);
    if (this.#jump === null) {
      if (rows.length > 3 * kept) rows.splice(0, rows.length - kept);
      return null;
    }
    if (this.#since < AFTER_S * this.#rate) return null;
    const step = measure(rows.slice(this.#jump - this.#rested), this.#rested, this.#rate);
    this.#rows = rows.slice(-kept);
    this.#jump = null;
    return step;
  }
}

// Returns the results of a step: overshoot, % of its height; noise before it, % of its height; rise from 10 to 90 %,
// s; settling to 5 %, s.
export function measure(rows, at, rate) {
  const from = rows[at - 1][1];
  const to = rows[at][1];
  const height = to - from;
  const part = rows.map((row) => (row[2] - from) / height);
  const after = part.slice(at);
  const before = part.slice(0, at);
  const rest = before.reduce((sum, one) => sum + one, 0) / at;
  const variance = before.reduce((sum, one) => sum + (one - rest) ** 2, 0) / at;
  const reach = (level) => after.findIndex((value) => value >= level);
  const [low, high] = [reach(0.1), reach(0.9)];
  const outside = after.findLastIndex((value) => Math.abs(value - 1) > BAND);
  const drawn = part.slice(Math.max(0, at - Math.round(BEFORE_S * rate)));
  return {
    tick: rows[at][0],
    height,
    times: drawn.map((_, i) => (i + part.length - drawn.length - at) / rate),
    part: drawn,
    noise: 100 * NOISE_DEVIATIONS * Math.sqrt(variance),
    overshoot: 100 * Math.max(0, Math.max(...after) - 1),
    rise: high < 0 ? NaN : (high - low) / rate,
    settling: outside === after.length - 1 ? NaN : (outside + 1) / rate,
  };
}
