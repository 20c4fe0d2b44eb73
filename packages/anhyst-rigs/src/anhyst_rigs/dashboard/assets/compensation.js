// The switch of the compensation: on and off in the air, from one tick on.

import { make } from "./dom.js";

export const NAME = "compensation"; // of the parameter: 1 or 0

// A button that shows and turns what is in force, whoever put it in force.
export function compensationSwitch(parameters) {
  const button = make("button", { id: NAME, onclick: () => parameters.toggle(NAME) });
  const show = () => {
    const on = parameters.value(NAME) !== 0;
    button.textContent = on ? "on (C)" : "off (C)";
    button.setAttribute("aria-pressed", String(on));
  };
  parameters.addEventListener("shown", show);
  show();
  return make("div", { className: "line" }, button);
}
