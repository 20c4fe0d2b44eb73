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
  #dropped = 0; // number of rows that newer rows have replaced

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

  // Returns a store with the same rows, which later rows do not change.
  copy() {
    const copy = new Store(0, this.#every, 0);
    copy.#capacity = this.#capacity;
    copy.#ticks = this.#ticks.slice();
    copy.#data = this.#data.map((column) => column.slice());
    copy.#begin = this.#begin;
    copy.#count = this.#count;
    copy.#dropped = this.#dropped;
    return Object.assign(copy, { newest: this.newest, missing: this.missing });
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
    else {
      this.#begin = (this.#begin + 1) % this.#capacity;
      this.#dropped++;
    }
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

  // Returns ticks and columns to draw: all rows, or the smallest and the largest value of each bin of rows in
  // their order of time, so that no spike is lost. A bin is at most a pixel wide. Missing values are NaN. `known`
  // keeps the complete bins of a plot from one picture to the next.
  envelope(columns, from, to, pixels, known = new Bins()) {
    const first = Math.max(0, this.find(from) - 1);
    const last = Math.min(this.#count, this.find(to) + 1);
    if (last - first <= 2 * pixels) return this.#plain(columns, first, last - first);
    known.fit((last - first) / pixels, 2 * pixels + 2);
    const { width } = known;
    const begin = Math.floor((this.#dropped + first) / width);
    const bins = Math.ceil((this.#dropped + last) / width) - begin;
    const row = (bin) => Math.max(0, Math.min(this.#count, (begin + bin) * width - this.#dropped));
    const ticks = new Float64Array(2 * bins);
    for (let bin = 0; bin < bins; bin++) {
      ticks[2 * bin] = this.tick(row(bin));
      ticks[2 * bin + 1] = this.tick((row(bin) + row(bin + 1)) >> 1);
    }
    return { ticks, columns: columns.map((n) => this.#extremes(this.#data[n], known.column(n), begin, bins, width)) };
  }

  #plain(columns, first, rows) {
    const take = (of) => {
      const out = new of.constructor(rows);
      for (let i = 0; i < rows; i++) out[i] = of[(this.#begin + first + i) % this.#capacity];
      return out;
    };
    return { ticks: take(this.#ticks), columns: columns.map((n) => take(this.#data[n])) };
  }

  #extremes(column, known, begin, bins, width) {
    const out = new Float32Array(2 * bins);
    const complete = (this.#dropped + this.#count) / width - 1; // largest number of a bin that has all its rows
    for (let bin = 0, number = begin; bin < bins; bin++, number++) {
      const place = number % known.numbers.length;
      const pair = 2 * place;
      if (known.numbers[place] !== number) {
        this.#measure(column, number * width - this.#dropped, width, known.values, pair);
        known.numbers[place] = number <= complete ? number : -1;
      }
      out[2 * bin] = known.values[pair];
      out[2 * bin + 1] = known.values[pair + 1];
    }
    return out;
  }

  // Writes the extremes of some rows in their order of time; NaN if a value is missing.
  #measure(column, row, count, out, place) {
    const first = Math.max(0, row);
    let at = (this.#begin + first) % this.#capacity;
    let low = column[at];
    let high = low;
    let lowFirst = true;
    let holed = low !== low;
    for (let n = Math.min(this.#count, row + count) - first; n > 1; n--) {
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
    out[place] = holed ? NaN : lowFirst ? low : high;
    out[place + 1] = holed ? NaN : lowFirst ? high : low;
  }
}

// The extremes of bins of rows, which do not change once all rows of a bin are stored.
export class Bins {
  width = 0; // rows in a bin
  #size = 0; // number of bins of each column
  #columns = new Map();

  // Chooses a width of at most some rows; forgets all bins if the width or their number changes.
  fit(rows, size) {
    if (this.width <= rows && this.width > rows / 2 && this.#size === size) return;
    this.width = Math.floor(rows);
    this.#size = size;
    this.#columns.clear();
  }

  // Returns the bins of a column: `numbers` contains the number of the bin in each place, -1 if it is not complete.
  column(n) {
    if (!this.#columns.has(n))
      this.#columns.set(n, { numbers: new Float64Array(this.#size).fill(-1), values: new Float32Array(2 * this.#size) });
    return this.#columns.get(n);
  }
}
