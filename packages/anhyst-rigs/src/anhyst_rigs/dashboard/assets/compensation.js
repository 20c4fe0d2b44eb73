// Switches the compensation on and off at one tick, also during levitation.

import { make } from "./dom.js";

export const NAME = "compensation"; // name of the parameter, which is 1 or 0

// Returns a button that shows and toggles the active state, which any browser may have set.
export function compensationSwitch(parameters) {
  const button = make("button", { id: NAME, title: "Switch the compensation of the hysteresis on or off", onclick: () => parameters.toggle(NAME) });
  const show = () => {
    const on = parameters.value(NAME) !== 0;
    button.textContent = on ? "On (C)" : "Off (C)";
    button.setAttribute("aria-pressed", String(on));
  };
  parameters.addEventListener("shown", show);
  show();
  return make("div", { className: "line" }, button);
}
