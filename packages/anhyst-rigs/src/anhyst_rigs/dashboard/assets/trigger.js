// Finds the tick at which a signal crosses a level, as frames come in.

export class Trigger {
  hit = null; // the tick of the first sample beyond the level

  #before = NaN;

  constructor(settings) {
    this.settings = settings; // column, level (SI), rising, pre (part of the picture), mode
  }

  rearm() {
    this.hit = null;
    this.#before = NaN;
  }

  feed(frame) {
    const { column, level, rising } = this.settings;
    const values = frame.data[column];
    for (let i = 0; i < values.length && this.hit === null; i++) {
      const crossed = rising
        ? this.#before < level && values[i] >= level
        : this.#before > level && values[i] <= level;
      if (crossed) this.hit = frame.ticks[i];
      this.#before = values[i];
    }
  }
}
