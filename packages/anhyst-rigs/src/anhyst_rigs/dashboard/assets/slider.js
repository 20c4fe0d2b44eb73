// The slider panel: the target, the load drive, or a parameter, as a field with a slider.

import { make } from "./dom.js";
import { aimName, describe } from "./names.js";
import { Quantity } from "./quantity.js";

const SEND_MS = 50; // delay of an order, which a further movement restarts

export function slider({ bench, order, parameters }, settings, save) {
  const specs = adjustable(bench, parameters);
  let chosen = specs.has(settings.of) ? settings.of : specs.keys().next().value;
  const place = make("div", { className: "slider-panel" });
  const options = [...specs].map(([key, { label }]) => make("option", { value: key, textContent: label }));
  const choice = make("select", { onchange: () => choose(choice.value) }, ...options);
  choice.setAttribute("aria-label", "quantity of the slider");
  let due = 0;
  let quantity = null;
  let active; // value that the bench uses
  const build = () => {
    const spec = specs.get(chosen);
    const send = () => order(spec.order, spec.fields(quantity.value));
    active = undefined;
    quantity = new Quantity({ ...spec, value: spec.now({}) }, () => {
      clearTimeout(due);
      due = setTimeout(send, SEND_MS);
    });
    place.replaceChildren(quantity.slider(), make("div", { className: "line" }, ...quantity.elements), quantity.message);
  };
  const choose = (key) => {
    chosen = choice.value = key;
    build();
    save({ of: key });
  };
  choice.value = chosen;
  build();
  const status = (bench) => {
    const spec = specs.get(chosen);
    const value = spec.now(bench);
    if (value !== active && value >= spec.low && value <= spec.high && !quantity.isBusy()) quantity.set(value);
    active = value;
    const reason = bench.refused[spec.order] ?? "";
    for (const one of place.querySelectorAll("input")) {
      one.disabled = Boolean(reason);
      one.title = reason;
    }
  };
  return { element: place, tools: [choice], status };
}

// Returns the quantities that a slider can adjust, by key.
function adjustable(bench, parameters) {
  const { aim, load_most: most } = bench;
  const middle = Math.min(aim.high, Math.max(aim.low, aim.value));
  const found = new Map([
    ["target", { label: aimName(bench), ...range(aim), now: ({ target }) => target ?? middle, order: "target", fields: (value) => ({ value }) }],
  ]);
  if (most) found.set("load", { label: "Load force", unit: "N", low: -most, high: most, now: ({ load }) => load ?? 0, order: "load", fields: (value) => ({ value }) });
  for (const one of bench.parameters) {
    const fields = (value) => ({ values: { [one.name]: value } });
    found.set(one.name, { label: describe(one).label, ...range(one), now: () => parameters.value(one.name), order: "apply", fields });
  }
  return found;
}

const range = ({ unit, low, high }) => ({ unit, low, high });
