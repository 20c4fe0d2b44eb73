// The variables of a foreign firmware: a search, and the choice of those that are sampled or can be changed.

import { make, refuse, select } from "./dom.js";

const SEARCH_MS = 200; // delay of a search, which a further key restarts

export function catalogue({ bench, order }) {
  const { catalogue, choices } = bench;
  const present = {
    signals: bench.signals.filter((one) => !one.expression).map((one) => one.name),
    parameters: bench.parameters.map((one) => one.name),
  };
  const chosen = { signals: new Set(present.signals), parameters: new Set(present.parameters) };
  const search = make("input", { type: "search", placeholder: `Search ${catalogue.variable_count} variables`, id: "variable-search" });
  search.setAttribute("aria-label", "search variables");
  const events = catalogue.events.map(({ number, name, period_s: s }) => [String(number), s ? `${name}, every ${s} s` : name]);
  const event = select(events, String(catalogue.event));
  event.setAttribute("aria-label", "event that samples");
  event.onchange = () => show();
  event.hidden = !events.length;
  const use = make("button", { id: "choose", className: "primary", title: "Sample and offer the chosen variables" });
  const again = make("button", { textContent: "Choose as last time", title: "Choose the variables that this browser used last" });
  const rows = make("tbody");
  const sampling = make("p", { className: "soft", textContent: `Sampling: ${catalogue.sampling}.` });
  const none = make("p", { className: "empty", textContent: "No variable has this name.", hidden: true });

  const send = async (choice) => {
    if (await order("choose", choice)) choices.set("variables", choice);
  };
  const choice = () => ({
    signals: [...chosen.signals],
    parameters: [...chosen.parameters],
    event: events.length ? Number(event.value) : null,
  });
  use.onclick = () => send(choice());
  const last = choices.get("variables", null);
  again.hidden = !last || String([last.signals, last.parameters]) === String([present.signals, present.parameters]);
  again.onclick = () => send(last);

  const show = () => {
    const { signals, parameters } = chosen;
    use.textContent = `Use ${signals.size} signals, ${parameters.size} parameters`;
    const same = String([[...signals], [...parameters], event.value]) === String([present.signals, present.parameters, catalogue.event ?? event.value]);
    const many = signals.size > catalogue.max_signals || parameters.size > catalogue.max_parameters;
    const limit = `choose at most ${catalogue.max_signals} signals and ${catalogue.max_parameters} parameters`;
    refuse(use, !signals.size ? "choose at least one signal" : many ? limit : same ? "this is the present choice" : "");
  };
  const tick = (kind, name, possible) => {
    const box = make("input", { type: "checkbox", checked: chosen[kind].has(name), disabled: !possible });
    box.setAttribute("aria-label", `${name} as ${kind === "signals" ? "signal" : "parameter"}`);
    box.onchange = () => {
      if (box.checked) chosen[kind].add(name);
      else chosen[kind].delete(name);
      show();
    };
    return make("td", {}, box);
  };
  const find = async () => {
    const answer = await order("find", { text: search.value });
    if (!answer) return;
    none.hidden = answer.found.length > 0;
    rows.replaceChildren(
      ...answer.found.map(({ name, unit, doc, writable }) =>
        make(
          "tr",
          {},
          tick("signals", name, true),
          tick("parameters", name, writable),
          make("th", { scope: "row", textContent: name }),
          make("td", { textContent: unit }),
          make("td", { className: "soft", textContent: doc }),
        ),
      ),
    );
  };
  let due = 0;
  search.oninput = () => {
    clearTimeout(due);
    due = setTimeout(find, SEARCH_MS);
  };
  const head = ["Signal", "Parameter", "Name", "Unit", "Description"].map((textContent) => make("th", { scope: "col", textContent }));
  const table = make("table", {}, make("thead", {}, make("tr", {}, ...head)), rows);
  show();
  find();
  return { element: make("div", { className: "tree scroll" }, sampling, table, none), tools: [search, event, use, again] };
}
