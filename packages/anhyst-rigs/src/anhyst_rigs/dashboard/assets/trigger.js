// Finds the tick at which a signal crosses a level, in each new frame.

export class Trigger {
  hit = null; // tick of the first sample at or beyond the level; null before

  #before = NaN;

  constructor(settings) {
    this.settings = settings; // name of the signal, level (SI), rising, pre (fraction of the window before the trigger), mode
  }

  rearm() {
    this.hit = null;
    this.#before = NaN;
  }

  // Searches the values of the signal in a frame.
  feed(frame, column) {
    const { level, rising } = this.settings;
    const values = frame.data[column] ?? [];
    for (let i = 0; i < values.length && this.hit === null; i++) {
      const crossed = rising
        ? this.#before < level && values[i] >= level
        : this.#before > level && values[i] <= level;
      if (crossed) this.hit = frame.ticks[i];
      this.#before = values[i];
    }
  }
}
