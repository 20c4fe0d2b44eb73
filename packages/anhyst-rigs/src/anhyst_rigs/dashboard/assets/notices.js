// Short messages for the user: one line that the user can dismiss, and an entry in the log with its time.

import { make } from "./dom.js";

const NOTICE_MS = 12000; // time after which a message disappears, unless it remains
export const SHORT_NOTICE_MS = 4000; // the same for a message without a reason or a remedy

export class Notices {
  #lasting = false; // whether the shown message is a state
  #state = "";
  #timer = 0;
  #shown = "";
  #count = 0; // how often the shown message has come

  constructor(place, log) {
    this.place = place;
    this.log = log;
    this.text = make("span");
    const close = make("button", { className: "small", textContent: "×", onclick: () => this.hide() });
    close.setAttribute("aria-label", "dismiss the message");
    this.close = close;
  }

  // Shows a message for a time; an equal message that is still shown is counted, so that it is visibly new.
  show(text, time = NOTICE_MS) {
    const isRepeated = text === this.#shown && !this.place.hidden;
    this.#count = isRepeated ? this.#count + 1 : 1;
    this.#put(text, this.#count > 1 ? `${text} (${this.#count} times)` : text);
    this.#lasting = false;
    this.#timer = setTimeout(() => this.hide(), time);
  }

  // Shows a state of the bench until it ends (empty text), or is dismissed or replaced.
  keep(text) {
    if (text === this.#state) return;
    this.#state = text;
    if (text) this.#put(text, text);
    else if (this.#lasting) this.hide();
    this.#lasting = Boolean(text);
  }

  #put(text, words) {
    this.#shown = text;
    this.text.textContent = words;
    this.place.replaceChildren(this.text, this.close); // restarts the animation
    this.place.hidden = false;
    clearTimeout(this.#timer);
  }

  // Hides a message whose fault is corrected: the next order was accepted.
  settle() {
    if (!this.#lasting) this.hide();
  }

  hide() {
    this.place.hidden = true;
  }

  // Empties the log before the entries of another bench.
  clear() {
    this.list = make("ol");
    this.empty = make("p", { className: "empty", textContent: "Nothing has happened yet. Commands, changes and errors appear here with their time." });
    this.log.replaceChildren(this.empty, this.list);
  }

  // Writes an entry into the log; time in s and tick of the bench.
  write(text, who, tick, rate, failed = false) {
    this.empty.hidden = true;
    const time = make("time", { textContent: `${(tick / rate).toFixed(3)} s` });
    time.title = `tick ${tick}`;
    const entry = make("li", { className: failed ? "failed" : "" }, time, make("b", { textContent: text }), make("span", { textContent: who }));
    this.list.prepend(entry);
  }
}
