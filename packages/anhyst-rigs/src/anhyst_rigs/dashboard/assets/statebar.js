// The states of the controller as a small diagram, the next command as the main button, and all other commands.

import { make, refuse } from "./dom.js";
import { words } from "./names.js";
import { VERBS, inWords, primary, route } from "./verbs.js";

export class StateBar {
  constructor(bench, order) {
    this.bench = bench;
    this.commands = bench.commands.filter((name) => VERBS[name]); // STOP has a button of its own
    this.states = new Map();
    const diagram = make("ol", { className: "states" });
    diagram.setAttribute("aria-label", "states");
    for (const [state, command] of route(bench.commands)) diagram.append(this.#state(state, command));
    this.fault = make("li", { className: "fault", textContent: "Fault", hidden: true });
    diagram.append(this.fault);
    this.buttons = new Map(this.commands.map((name) => [name, this.#button(name, order)]));
    this.main = make("div", { className: "main" });
    this.others = make("div", { className: "commands" });
    this.element = make("div", {}, diagram, this.main, this.others);
    this.#arrange(undefined);
  }

  #state(state, command) {
    const node = make("b", { textContent: words(state) });
    const arrow = command ? [make("span", { className: "arrow", textContent: `${VERBS[command][0].split(" ")[0]} →` })] : [];
    const item = make("li", {}, ...arrow, node);
    this.states.set(state, item);
    return item;
  }

  #button(name, order) {
    const [textContent, title] = VERBS[name];
    const button = make("button", { textContent, title, onclick: () => order("command", { name }) });
    button.dataset.order = name;
    return button;
  }

  // Puts one command into the place of the main button.
  #arrange(main) {
    this.shownMain = main;
    this.main.replaceChildren(...(main ? [this.buttons.get(main)] : [this.note = make("p", { className: "soft" })]));
    this.others.replaceChildren(...this.commands.filter((name) => name !== main).map((name) => this.buttons.get(name)));
  }

  status({ state, refused }) {
    const name = this.bench.states[state] ?? "";
    const main = primary(this.commands, name, refused);
    const focused = document.activeElement?.dataset.order;
    if (main !== this.shownMain) {
      this.#arrange(main);
      if (focused) this.buttons.get(focused)?.focus();
    }
    if (!main) this.note.textContent = name === "run" ? runningHint(refused.target, this.bench.aim) : "Wait until this state ends.";
    for (const [command, button] of this.buttons) refuse(button, refused[command]);
    const shown = { init: "idle", selftest: "idle" }[name] ?? name;
    const order = [...this.states.keys()];
    for (const [one, item] of this.states) {
      item.toggleAttribute("aria-current", one === shown);
      item.classList.toggle("next", order.indexOf(one) === order.indexOf(shown) + 1 && order.includes(shown));
    }
    this.fault.hidden = name !== "fault";
  }
}

// Returns what the user can do while the rig runs, or why the target is refused.
function runningHint(refusal, { is_offset: isOffset }) {
  return refusal ? `Running. ${inWords(refusal)}.` : `Running: set ${isOffset ? "an offset" : "a target"}, or start the generator.`;
}
