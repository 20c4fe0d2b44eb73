// Short messages for the user: one line that the user can dismiss, and an entry in the log with its time.

import { make } from "./dom.js";

const NOTICE_MS = 12000; // time after which a message disappears, unless it remains
export const SHORT_NOTICE_MS = 4000; // the same for a message without a reason or a remedy

export class Notices {
  #timer = 0;

  constructor(place, log) {
    this.place = place;
    this.log = log;
    this.text = make("span");
    const close = make("button", { className: "small", textContent: "×", onclick: () => this.hide() });
    close.setAttribute("aria-label", "dismiss the message");
    this.close = close;
  }

  // Shows a message; `lasting` messages remain until they are dismissed or replaced.
  show(text, lasting = false, time = NOTICE_MS) {
    if (this.text.textContent === text && !this.place.hidden) return;
    this.text.textContent = text;
    this.place.replaceChildren(this.text, this.close);
    this.place.hidden = false;
    clearTimeout(this.#timer);
    if (!lasting) this.#timer = setTimeout(() => this.hide(), time);
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
