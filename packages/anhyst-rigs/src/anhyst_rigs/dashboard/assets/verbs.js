// The commands of a controller in words: what a button says and what it does; and the states that they connect.

import { describe } from "./names.js";
import { showParameter } from "./quantity.js";
import { show } from "./units.js";

// Label and effect by command.
export const VERBS = {
  condition: ["Condition iron", "Drive the conditioning sequence, which brings the iron into a known state; then Ready"],
  demagnetised: ["Assume demagnetised", "The iron is demagnetised, so its state is known without conditioning; then Ready"],
  lift: ["Lift", "Lift the body under control and hold it at the target"],
  land: ["Land", "Lower the body under control, then switch the current off"],
  run: ["Run", "Follow the target"],
  clear: ["Clear fault", "Leave the state Fault when the current is zero"],
  idle: ["Switch off", "Switch the current off and return to Idle"],
  arm: ["Make ready", "Go from Idle to Ready and keep the present hysteresis state, without conditioning"],
};

// Commands that lead to a running rig, in order; one of each group suffices.
const PATH = [["clear"], ["condition", "demagnetised"], ["lift"], ["run"]];

// Replaces the names of commands in a text by the labels of their buttons.
export function inWords(text) {
  const plain = text.replace(/\b(condition|demagnetised|lift|run|clear)\b(?! is|:)/g, (name) => VERBS[name][0]);
  return plain.charAt(0).toUpperCase() + plain.slice(1);
}

const NUMBER = "-?\\d[\\d.]*(?:e[-+]?\\d+)?";
const SETTING = new RegExp(`([A-Za-z_]\\w*) = (${NUMBER})`, "g");
const AMOUNT = new RegExp(`(${NUMBER}) (m|rad|N|A|V|Wb|T)(?![\\w/])`, "g");

// Returns a text of the log with the names and units of the page: "target 0.00047 m" as "Target 470 µm".
export function inPlainWords(text, bench) {
  if (VERBS[text]) return VERBS[text][0];
  const setting = (all, name, value) => {
    const parameter = bench.parameters.find((one) => one.name === name);
    return parameter ? `${describe(parameter).label} ${showParameter({ ...parameter, value: Number(value) })}` : all;
  };
  const plain = text.replace(SETTING, setting).replace(AMOUNT, (_, value, unit) => show(Number(value), unit)).replace(/ um\b/g, " µm");
  return /^\S+\.(mf4|csv)/.test(plain) ? plain : plain.charAt(0).toUpperCase() + plain.slice(1);
}

// Returns the command that leads on from the present state; undefined if the rig runs or the user must wait.
export function primary(commands, state, refused) {
  if (state === "run") return undefined;
  const lifted = commands.includes("run") && state !== "idle"; // a stage lifts its body before it runs
  const possible = PATH.map((group) => group.filter((name) => commands.includes(name) && !(lifted && name === "lift")));
  return possible.map((group) => group.find((name) => !refused[name])).findLast(Boolean);
}

// Returns the states of a rig in order, with the command that leads to each: [state, command].
export function route(commands) {
  const has = (name) => commands.includes(name);
  const toRun = has("run") ? "run" : "lift";
  if (has("condition")) return [["idle", ""], ["ready", "condition"], ["run", toRun]];
  if (has("lift")) return [["idle", ""], ["ready", "lift"], ["run", toRun]];
  return [["ready", ""], ["run", toRun]];
}
