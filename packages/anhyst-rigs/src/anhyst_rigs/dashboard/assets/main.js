// Connects the link, the views and the controls.

import { BodyView } from "./body.js";
import { NAME as COMPENSATION } from "./compensation.js";
import { download, keeping, make, refuse } from "./dom.js";
import { Improve } from "./improve.js";
import { Learning } from "./learn.js";
import { LevitationView } from "./levitation.js";
import { Link } from "./link.js";
import { LoopView } from "./loop.js";
import { Panel } from "./panel.js";
import { Parameters } from "./parameters.js";
import { csv, picture } from "./picture.js";
import { Scope } from "./scope.js";
import { Sets } from "./sets.js";
import { columnOf } from "./signals.js";
import { SpectrumView } from "./spectrum.js";
import { StepView } from "./steps.js";
import { Store } from "./store.js";

const VIEWS = ["scope", "loop", "steps", "parameters", "log", "improve", "levitation", "spectrum", "learning", "body"];
const VIEW_KEYS = "1234567890"; // keys of the views
const NOTICE_MS = 8000;

const at = (id) => document.getElementById(id);
const kept = keeping(); // choices for this browser and any rig
const link = new Link(askToken);
let page = null; // views and their data; null until the bench is known
let view = "scope";

link.addEventListener("bench", (event) => open(event.detail));
link.addEventListener("frame", (event) => feed(event.detail));
link.addEventListener("status", (event) => status(event.detail));
link.addEventListener("parameters", (event) => page?.parameters.take(event.detail.parameters, event.detail.applied));
link.addEventListener("improve", (event) => page?.improve.show(event.detail.results));
link.addEventListener("learnt", (event) => (page?.learning ?? page?.improve)?.learnt(event.detail.laps));
link.addEventListener("loops", (event) => page?.loop.know(event.detail.loops));
link.addEventListener("lost", (event) => lost(event.detail));

// Sends an order and returns its answer. If the order is refused, shows the reason and returns null.
async function order(what, fields) {
  try {
    return await link.order(what, fields);
  } catch (refused) {
    notify(refused.message);
    return null;
  }
}

function open(bench) {
  bench.choices = keeping(bench.title);
  const store = new Store(bench.signals.length, bench.every);
  const parameters = new Parameters(at("parameters"), order, bench.choices);
  parameters.take(bench.parameters, 0);
  const both = bench.learns && bench.limits; // the learning view is separate only if there is also an improve view
  page = {
    bench,
    store,
    parameters,
    sets: new Sets(at("parameters"), parameters, order),
    scope: new Scope(at("scope"), bench, store),
    loop: new LoopView(at("loop"), bench, store),
    steps: new StepView(at("steps"), bench, (tick) => parameters.label(tick)),
    improve:
      bench.limits || bench.learns || bench.keeps_time
        ? new (bench.learns && !both ? Learning : Improve)(at("improve"), bench, order)
        : null,
    learning: both ? new Learning(at("learning"), bench, order) : null,
    levitation: new LevitationView(at("levitation"), bench, store),
    spectrum: new SpectrumView(at("spectrum"), bench, store),
    body: bench.body ? new BodyView(at("body"), bench, store) : null,
    panel: new Panel(at("panel"), bench, order, parameters),
  };
  for (const tab of at("tabs").children) tab.hidden = !offered(tab.dataset.view);
  at("title").textContent = bench.title;
  document.title = `${bench.title} – anhyst live`;
  at("log").replaceChildren(make("ol"));
  document.body.classList.remove("lost");
  window.anhyst = page;
  choose(bench.choices.get("view", "scope"));
}

function feed(frame) {
  if (!page) return;
  page.store.push(frame);
  page.scope.feed(frame);
  page.steps.feed(frame);
}

function status(now) {
  const { bench, store } = page;
  const last = (name) => {
    const column = columnOf(bench, name);
    return column < 0 || !store.count ? undefined : store.value(column, store.count - 1);
  };
  page.panel.status(now, { load: last("load"), gap: last("gap") });
  const state = now.ended || now.lost ? "lost" : (bench.states[now.state] ?? now.state);
  at("state").textContent = state;
  at("state").dataset.state = state;
  at("fault").textContent = now.fault ? bench.faults[now.fault] : "";
  at("next").textContent = now.next;
  facts({
    time: `${(now.tick / bench.rate).toFixed(2)} s`,
    "real time": now.paused ? "paused" : `× ${now.factor.toFixed(2)}`,
    ...(bench.keeps_time
      ? { "missing ticks": String(now.missing) }
      : { "late at most": `${(1e3 * now.lateness).toFixed(1)} ms`, slips: String(now.slips) }),
    recorded: recorded(now.recording),
  });
  page.parameters.status(now);
  page.improve?.status(now);
  page.learning?.status(now);
  page.sets.status(now);
  role(now);
  for (const entry of now.log) write(entry);
  if (now.ended) notify(now.ended);
  else if (now.lost) notify(`${now.lost}; looking for it`);
  else if (now.waits_for) notify(`the bench waits for ${now.waits_for}`);
}

function recorded(file) {
  if (!file) return "no";
  return file.waits ? "armed" : `${file.rows} ticks, ${file.file}`;
}

function facts(values) {
  const items = Object.entries(values).map(([name, text]) =>
    make("div", {}, make("dt", { textContent: name }), make("dd", { textContent: text })),
  );
  at("facts").replaceChildren(...items);
}

// Shows which browser operates the bench, and which one requests control.
function role({ operator, asking, browsers }) {
  const mine = operator === page.bench.you;
  document.body.classList.toggle("watching", !mine);
  const key = [mine, asking, operator, browsers].join();
  if (at("role").dataset.key === key) return;
  at("role").dataset.key = key;
  const parts = [
    make("b", { textContent: mine ? "you operate" : `browser ${operator} operates, you watch` }),
  ];
  if (browsers > 1) parts.push(` (${browsers} browsers) `);
  const button = (text, act) => parts.push(make("button", { textContent: text, onclick: act }));
  if (!mine && !asking) button("take over", () => order("ask"));
  if (!mine && asking === page.bench.you) parts.push(" asked; waits 10 s at most");
  if (mine && asking) {
    button(`hand over to browser ${asking}`, () => order("hand over", { yes: true }));
    button("keep", () => order("hand over", { yes: false }));
  }
  at("role").replaceChildren(...parts);
}

function write({ tick, who, text }) {
  const time = `${(tick / page.bench.rate).toFixed(3)} s, tick ${tick}`;
  at("log").firstChild.prepend(
    make("li", {}, make("b", { textContent: text }), ` ${time}, ${who}`),
  );
}

let forget = 0;
function notify(text) {
  at("notice").textContent = text;
  at("notice").hidden = false;
  clearTimeout(forget);
  forget = setTimeout(() => (at("notice").hidden = true), NOTICE_MS);
}

function lost(reason) {
  document.body.classList.add("lost");
  at("state").textContent = "not connected";
  notify(`not connected${reason ? `: ${reason}` : ""}; trying again`);
}

function askToken() {
  const dialog = at("token");
  const input = dialog.querySelector("input");
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => resolve(input.value);
  });
}

// Whether the bench has a view; some views exist only for some benches.
const offered = (name) => !["improve", "learning", "body"].includes(name) || Boolean(page?.[name]);

function choose(wanted) {
  const name = [wanted, wanted === "learning" ? "improve" : "scope", "scope"].find(offered);
  view = name;
  page?.bench.choices.set("view", name);
  const none = page?.[name]?.table ? "" : "this view has no data yet";
  for (const button of [at("png"), at("csv")]) refuse(button, none);
  for (const one of VIEWS) at(one).hidden = one !== name;
  for (const tab of at("tabs").children)
    tab.setAttribute("aria-selected", tab.dataset.view === name);
}

// Saves the open view as a file: a picture, or its values as CSV.
async function save(kind) {
  const { bench, store } = page;
  const shown = page[view];
  const name = `${bench.title.replace(/\W+/g, "-")}-${view}-${store.newest}.${kind}`;
  if (kind === "csv") return download(name, new Blob([csv(shown.table())], { type: "text/csv" }));
  const title = `${bench.title}, ${view}, tick ${store.newest}`;
  return download(name, await picture(at(view), [[[title]], ...shown.words()]));
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  kept.set("theme", name);
  page?.scope.restyle();
}

const turnTheme = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
const stop = () => order("stop now");

const KEYS = {
  " ": () => page?.scope.toggle(),
  "+": () => page?.scope.widen(-1),
  "-": () => page?.scope.widen(1),
  b: () => page?.parameters.rollBack(),
  c: () => page?.parameters.toggle(COMPENSATION),
  t: turnTheme,
};

document.addEventListener(
  "keydown",
  (event) => {
    if (event.key === "Escape") {
      event.preventDefault();
      stop();
      return;
    }
    if (event.target.matches("input, select") || event.ctrlKey || event.altKey || event.metaKey)
      return;
    const keyed = VIEWS[VIEW_KEYS.indexOf(event.key)];
    const act = KEYS[event.key.toLowerCase()] ?? (keyed && (() => choose(keyed)));
    if (act) {
      event.preventDefault();
      act();
    }
  },
  true,
);

function draw() {
  if (page?.[view]?.draw) page[view].draw();
  requestAnimationFrame(draw);
}

for (const [n, name] of VIEWS.entries()) {
  const tab = make("button", {
    textContent: `${VIEW_KEYS[n]} ${name}`,
    role: "tab",
    onclick: () => choose(name),
  });
  tab.dataset.view = name;
  at("tabs").append(tab);
}
at("png").onclick = () => save("png");
at("csv").onclick = () => save("csv");
at("theme").onclick = turnTheme;
at("stop").onclick = stop;
theme(kept.get("theme", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
choose("scope");
draw();
