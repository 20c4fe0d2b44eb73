// The drift monitor: shows whether the active model still fits the bench.

import { make, refuse } from "./dom.js";

export class Watch {
  constructor(order) {
    this.on = false;
    this.button = make("button", {
      onclick: () => order("improve", { step: "watch", on: !this.on }),
    });
    this.again = make("button", {
      textContent: "Learn again",
      onclick: () => order("improve", { step: "watch", on: true }),
    });
    this.text = make("output", { id: "watched" });
    this.note = make("output", { className: "soft" });
    this.element = make("div", { className: "bar" }, this.button, this.again, this.text, this.note);
    this.show(null);
  }

  refuse(reason) {
    refuse(this.button, reason);
    refuse(this.again, reason);
  }

  show(watch) {
    this.on = Boolean(watch);
    this.button.textContent = this.on ? "Stop watching" : "Watch for drift";
    this.again.hidden = !this.on;
    this.text.dataset.watch = watch?.state ?? "";
    this.text.textContent = watch?.text ?? "";
    this.note.textContent = watch?.run_length ? said(watch) : "";
  }
}

// Returns a text on the false-alarm rate, the residual, and the improvement that a new measurement would give.
function said({ state, run_length, least_N, usual_N, left_N, gain_N }) {
  const rate = `one false alarm in ${run_length.toLocaleString("en")} cycles in the mean, smallest drift ${short(least_N)} N`;
  if (state === "learning") return `${rate}; swing the current to and fro: standstill shows nothing`;
  const left = `leaves ${short(left_N)} N rms, ${short(usual_N)} N while learning`;
  return state === "drifted"
    ? `measuring again takes about ${short(gain_N)} N rms off the error`
    : `${left}; ${rate}`;
}

function short(value) {
  return String(Number(value.toPrecision(3)));
}
