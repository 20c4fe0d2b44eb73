// Finds steps of the reference in the samples, and computes overshoot, rise and settling times.

const MAX_STEPS = 24; // number of steps that are kept
const BEFORE_S = 0.01; // time for which the reference must be constant before a step
const AFTER_S = 0.06; // time for which it must be constant after a step
const MIN_HEIGHT_RATIO = 1e-3; // smallest height of a step, as a fraction of the reference before it
const BAND = 0.05; // settling band, as a fraction of the step height

export class StepFinder {
  steps = []; // the last steps; a new array after each change

  #rate; // rows per second
  #every; // ticks between two rows
  #columns;
  #rows = []; // recent rows: [tick, reference, actual]
  #since = 0; // rows since the reference last changed
  #jump = null; // row of a step that has not settled yet; null if there is none

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
      if (step) this.steps = [...this.steps, { ...step, label: this.inForce(step.tick) }].slice(-MAX_STEPS);
    }
  }

  #reset() {
    this.#rows = [];
    this.#since = 0;
    this.#jump = null;
  }

  #row(tick, reference, actual) {
    const rows = this.#rows;
    const last = rows.at(-1);
    if (last && tick !== last[0] + this.#every) this.#reset();
    if (last && reference !== last[1]) {
      const rested = this.#since >= BEFORE_S * this.#rate;
      const high = Math.abs(reference - last[1]) > MIN_HEIGHT_RATIO * Math.abs(last[1]);
      this.#jump = rested && high ? rows.length : null;
      this.#since = 0;
    } else this.#since++;
    rows.push([tick, reference, actual]);
    const before = Math.round(BEFORE_S * this.#rate);
    if (this.#jump === null) {
      if (rows.length > 4 * before) rows.splice(0, rows.length - 2 * before);
      return null;
    }
    if (this.#since < AFTER_S * this.#rate) return null;
    const step = measure(rows.slice(this.#jump - before), before, this.#rate);
    this.#rows = rows.slice(-before);
    this.#jump = null;
    return step;
  }
}

// Returns the results of a step: overshoot, % of its height; rise from 10 to 90 %, s; settling to 5 %, s.
export function measure(rows, at, rate) {
  const from = rows[at - 1][1];
  const to = rows[at][1];
  const height = to - from;
  const part = rows.map((row) => (row[2] - from) / height);
  const after = part.slice(at);
  const reach = (level) => after.findIndex((value) => value >= level);
  const [low, high] = [reach(0.1), reach(0.9)];
  const outside = after.findLastIndex((value) => Math.abs(value - 1) > BAND);
  return {
    tick: rows[at][0],
    height,
    times: part.map((_, i) => (i - at) / rate),
    part,
    overshoot: 100 * Math.max(0, Math.max(...after) - 1),
    rise: high < 0 ? NaN : (high - low) / rate,
    settling: outside === after.length - 1 ? NaN : (outside + 1) / rate,
  };
}
