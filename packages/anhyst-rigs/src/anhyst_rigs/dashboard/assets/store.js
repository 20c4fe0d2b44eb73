// Stores the last rows of all signals, and returns their range for each pixel.

const CAPACITY = 1 << 19; // number of rows of a running bench

export class Store {
  newest = 0;
  missing = []; // intervals [first, last] of missing ticks

  #capacity;
  #ticks;
  #data;
  #every; // ticks between two rows if no tick is missing
  #begin = 0;
  #count = 0;

  constructor(columns, every = 1, capacity = CAPACITY) {
    this.#every = every;
    this.#capacity = capacity;
    this.#ticks = new Float64Array(capacity);
    this.#data = Array.from({ length: columns }, () => new Float32Array(capacity));
  }

  // Arranges the columns: each takes the values of a previous column, or has no values in the stored rows (-1).
  arrange(previous) {
    this.#data = previous.map((n) => this.#data[n] ?? new Float32Array(this.#capacity).fill(NaN));
  }

  get count() {
    return this.#count;
  }

  get oldest() {
    return this.#count ? this.#ticks[this.#begin] : 0;
  }

  push(frame) {
    if (this.#count && frame.first > this.newest + this.#every)
      this.#lose(this.newest + 1, frame.first - 1);
    const rows = frame.ticks.length;
    for (let i = 0; i < rows; i++) {
      const at = this.#place(frame.ticks[i]);
      for (let n = 0; n < this.#data.length; n++) this.#data[n][at] = frame.data[n] ? frame.data[n][i] : NaN;
    }
    this.newest = frame.last;
  }

  #lose(first, last) {
    this.missing = [...this.missing.slice(-99), [first, last]];
    const at = this.#place(first);
    for (const column of this.#data) column[at] = NaN;
  }

  #place(tick) {
    let at = this.#begin + this.#count;
    if (this.#count < this.#capacity) this.#count++;
    else this.#begin = (this.#begin + 1) % this.#capacity;
    at %= this.#capacity;
    this.#ticks[at] = tick;
    return at;
  }

  // Returns the number of the first row at or after a tick.
  find(tick) {
    let low = 0;
    let high = this.#count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.#ticks[(this.#begin + middle) % this.#capacity] < tick) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  tick(row) {
    return this.#ticks[(this.#begin + row) % this.#capacity];
  }

  value(column, row) {
    return this.#data[column][(this.#begin + row) % this.#capacity];
  }

  // Returns the largest absolute value of a column from a row on.
  largest(column, first) {
    const data = this.#data[column];
    let most = 0;
    for (let row = first; row < this.#count; row++) {
      const size = Math.abs(data[(this.#begin + row) % this.#capacity]);
      if (size > most) most = size;
    }
    return most;
  }

  // Returns ticks and columns to draw: all rows, or the smallest and the largest value of each pixel in
  // their order of time, so that no spike is lost. Missing values are NaN.
  envelope(columns, from, to, pixels) {
    const first = Math.max(0, this.find(from) - 1);
    const last = Math.min(this.#count, this.find(to) + 1);
    const rows = last - first;
    if (rows <= 2 * pixels) return this.#plain(columns, first, rows);
    const edges = Uint32Array.from(
      { length: pixels + 1 },
      (_, p) => first + Math.floor((p * rows) / pixels),
    );
    const ticks = new Float64Array(2 * pixels);
    for (let p = 0; p < pixels; p++) {
      ticks[2 * p] = this.tick(edges[p]);
      ticks[2 * p + 1] = this.tick((edges[p] + edges[p + 1]) >> 1);
    }
    return { ticks, columns: columns.map((n) => this.#extremes(this.#data[n], edges)) };
  }

  #plain(columns, first, rows) {
    const take = (of) => {
      const out = new of.constructor(rows);
      for (let i = 0; i < rows; i++) out[i] = of[(this.#begin + first + i) % this.#capacity];
      return out;
    };
    return { ticks: take(this.#ticks), columns: columns.map((n) => take(this.#data[n])) };
  }

  #extremes(column, edges) {
    const out = new Float32Array(2 * (edges.length - 1));
    for (let p = 0; p + 1 < edges.length; p++) {
      let at = (this.#begin + edges[p]) % this.#capacity;
      let low = column[at];
      let high = low;
      let lowFirst = true;
      let holed = Number.isNaN(low);
      for (let i = edges[p] + 1; i < edges[p + 1]; i++) {
        if (++at === this.#capacity) at = 0;
        const value = column[at];
        if (value < low) {
          low = value;
          lowFirst = false;
        } else if (value > high) {
          high = value;
          lowFirst = true;
        } else if (value !== value) holed = true;
      }
      out[2 * p] = holed ? NaN : lowFirst ? low : high;
      out[2 * p + 1] = holed ? NaN : lowFirst ? high : low;
    }
    return out;
  }
}
