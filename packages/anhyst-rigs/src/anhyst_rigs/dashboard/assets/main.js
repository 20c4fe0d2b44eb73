// Connects the link, the views and the controls.

import { NAME as COMPENSATION } from "./compensation.js";
import { Desks } from "./desks.js";
import { download, keeping, make, refuse } from "./dom.js";
import { Link } from "./link.js";
import { Notices, SHORT_NOTICE_MS } from "./notices.js";
import { Panel } from "./panel.js";
import { kinds } from "./panels.js";
import { Parameters } from "./parameters.js";
import { Scope } from "./scope.js";
import { SignalList } from "./signallist.js";
import { columnOf, label } from "./signals.js";
import { StepFinder } from "./stepfinder.js";
import { Store } from "./store.js";
import { inPlainWords, inWords } from "./verbs.js";
import { VIEWS } from "./views.js";

const MAX_CYCLES = 500; // largest number of learning cycles that are kept

const at = (id) => document.getElementById(id);
const kept = keeping(); // choices for this browser and any rig
const notices = new Notices(at("notice"), at("log"));
const link = new Link(askToken);
let page = null; // views and their data; null until the bench is known
let view = "scope";

link.addEventListener("bench", (event) => open(event.detail));
link.addEventListener("frame", (event) => feed(event.detail));
link.addEventListener("status", (event) => status(event.detail));
link.addEventListener("signals", (event) => page && adopt(event.detail.signals));
link.addEventListener("parameters", (event) => page?.parameters.take(event.detail.parameters, event.detail.applied));
link.addEventListener("improve", (event) => page && keep("results", event.detail.results, "show"));
link.addEventListener("learnt", (event) => page && keep("laps", [...page.bench.laps, ...event.detail.laps].slice(-MAX_CYCLES), "learnt"));
link.addEventListener("response", (event) => page && keep("measured", event.detail.result));
link.addEventListener("recordings", (event) => {
  if (!page) return;
  keep("recordings", event.detail.recordings, "listRecordings");
  page.panel.recorder.finished.list();
});
link.addEventListener("loops", (event) => page && keep("loops", event.detail.loops, "know"));
link.addEventListener("lost", (event) => lost(event.detail));

// Sends an order and returns its answer. If the order is refused, shows the reason, at its control if the control
// passes `show`, and returns null.
async function order(what, fields, show = notify) {
  try {
    const answer = await link.order(what, fields);
    notices.settle();
    return answer;
  } catch (refused) {
    show(refused.message);
    if (show !== notify) record(refused.message);
    return null;
  }
}

// Shows a message that the user can dismiss, and writes it into the log.
function notify(text) {
  notices.show(text);
  record(text);
}

function record(text) {
  if (page) notices.write(text, "this page", page.store.newest, page.bench.rate, true);
}

// Stores results of the server for views that the user opens later, and shows them in the open views.
function keep(name, value, act) {
  page.bench[name] = value;
  for (const shown of page.views.values()) shown?.[act]?.(value);
}

function open(bench) {
  Object.assign(bench, { laps: [], results: {} });
  bench.choices = keeping(bench.title);
  const lastView = bench.choices.get("view", "scope");
  label(bench);
  notices.clear();
  const store = new Store(bench.signals.length, bench.every);
  const parameters = new Parameters(at("parameters"), order, bench.choices);
  parameters.take(bench.parameters, 0);
  const scope = new Scope({ view: at("scope"), bar: at("timebar"), figures: at("figures") }, bench, store, notify);
  const panel = new Panel(at("panel"), bench, order, parameters);
  const aims = [bench.aim.reference, bench.aim.signal].map((name) => columnOf(bench, name));
  const finder = new StepFinder(bench, ...aims, (tick) => parameters.label(tick));
  page = { bench, store, parameters, scope, finder, panel };
  page.layouts = new Map([[bench.signals.length, bench.signals.map((one) => one.name)]]);
  page.views = new Map([["scope", scope]]); // the views that were opened, by name
  page.context = { bench, store, scope, finder, parameters, order, notify, status: null };
  tabs();
  page.list = new SignalList(at("signals"), bench, store, order, () => shownDesk()?.plot() ?? scope.plot);
  page.desks = new Desks(at("desks"), at("desktabs"), page.context, (n) => choose(n === null ? view : `desk ${n}`));
  at("title").textContent = bench.title;
  refuse(at("stop"), bench.commands.length ? "" : "This firmware has no stop that anhyst knows.");
  document.title = `${bench.title} – anhyst live`;
  document.body.classList.remove("lost");
  window.anhyst = page;
  choose(lastView);
}

const fixedKinds = () => kinds(page.bench).filter((kind) => kind.fixed);

// Makes a view, or a desk, when the user opens it for the first time; its code may have to be loaded.
async function load(name) {
  const { views, context, desks } = page;
  const { make: makeView } = VIEWS.find((one) => one.name === name) ?? {};
  const kind = fixedKinds().find((one) => one.kind === name);
  if (name.startsWith("desk ")) return desks.open(Number(name.slice(5)));
  if (views.has(name) || !(makeView || kind)) return null;
  views.set(name, null);
  const made = await (makeView ? makeView(at(name), context) : fixedPanel(kind, context));
  views.set(name, made);
  if (context.status) made.status?.(context.status);
  return made;
}

// Makes a view of a panel that has a fixed tab.
async function fixedPanel(kind, context) {
  const { choices } = context.bench;
  const panel = await kind.make(context, choices.get(kind.kind, {}), (settings) => choices.set(kind.kind, settings));
  at(kind.kind).replaceChildren(...(panel.tools ? [make("div", { className: "bar" }, ...panel.tools)] : []), panel.element);
  return panel;
}

// Adopts the signals of the bench after a derived signal was defined or deleted.
function adopt(signals) {
  const { bench, scope, list } = page;
  const old = bench.signals;
  bench.signals = signals;
  label(bench);
  page.layouts.set(signals.length, signals.map((one) => one.name));
  bench.choices.set("derived", signals.filter((one) => one.expression).map(({ name, expression, unit }) => ({ name, expression, unit })));
  scope.arrange(signals.map((one) => old.findIndex(({ name }) => name === one.name)));
  for (const choice of document.querySelectorAll("select.signalchoice")) choice.choose();
  scope.rebuild();
  list.build();
}

// Defines the derived signals of this rig again that the browser has stored, once per connection.
async function restoreDerived() {
  if (page.restored) return;
  page.restored = true;
  const { bench } = page;
  for (const derived of bench.choices.get("derived", []))
    if (columnOf(bench, derived.name) < 0) await order("derive", derived);
}

const shownDesk = () => (view.startsWith("desk ") ? page?.desks?.desks[Number(view.slice(5))] : null);
const shownView = () => shownDesk() ?? page?.views.get(view);

function feed(frame) {
  if (!page) return;
  const { signals } = page.bench;
  if (frame.data.length !== signals.length) {
    // The frame was sent before a derived signal was defined or deleted, so it has the columns of that time.
    const columns = page.layouts.get(frame.data.length) ?? [];
    frame.data = signals.map(({ name, expression }, n) => frame.data[columns.indexOf(name)] ?? (expression ? undefined : frame.data[n]));
  }
  page.store.push(frame);
  page.scope.feed(frame);
  page.finder.feed(frame);
}

function status(now) {
  const { bench, store, context } = page;
  const isFirst = !context.status; // its log contains what happened before the page was opened
  context.status = now; // for views and panels that open before the next message
  const last = (name) => {
    const column = columnOf(bench, name);
    return column < 0 || !store.count ? undefined : store.value(column, store.count - 1);
  };
  page.panel.status(now, { load: last("load"), gap: last("gap") });
  const state = now.ended || now.lost ? "lost" : (bench.states[now.state] ?? now.state);
  at("state").textContent = state;
  at("state").dataset.state = state;
  at("fault").textContent = now.fault ? bench.faults[now.fault] : "";
  at("next").textContent = inWords(now.next);
  facts({
    Time: `${(now.tick / bench.rate).toFixed(2)} s`,
    "Real time": now.paused ? "paused" : `× ${now.factor.toFixed(2)}`,
    ...(bench.keeps_time
      ? { "Missing ticks": String(now.missing) }
      : { "Late at most": `${(1e3 * now.lateness).toFixed(1)} ms`, Slips: String(now.slips) }),
    Recorded: recorded(now.recording),
  });
  page.parameters.status(now);
  for (const shown of page.views.values()) shown?.status?.(now);
  shownDesk()?.status(now);
  role(now);
  if (!now.refused.derive) restoreDerived();
  for (const { tick, who, text } of now.log) {
    const plain = inPlainWords(text, bench);
    notices.write(plain, who, tick, bench.rate);
    if (who === "learning" && !isFirst) notices.show(plain);
  }
  notices.keep(now.ended || (now.lost && `${now.lost}; looking for it`) || (now.waits_for && `the bench waits for ${now.waits_for}`) || "");
}

function recorded(file) {
  if (!file) return "no";
  return file.waits ? "armed" : `${file.rows} ticks, ${file.file}`;
}

// What the readings at the top mean.
const FACTS = {
  "Real time": "Speed of the rig, relative to real time",
  "Late at most": "Largest delay of the rig behind real time in the last second",
  Slips: "How often the machine was too slow for real time; no tick was lost",
  "Missing ticks": "Ticks that did not arrive",
};

function facts(values) {
  const place = at("facts");
  const names = Object.keys(values);
  if (place.childElementCount !== names.length)
    place.replaceChildren(...names.map((name) => make("div", { title: FACTS[name] ?? "" }, make("dt", { textContent: name }), make("dd"))));
  for (const [n, name] of names.entries()) place.children[n].lastChild.textContent = values[name];
}

// Shows which browser operates the bench, and which one requests control.
function role({ operator, asking, browsers }) {
  const mine = operator === page.bench.you;
  document.body.classList.toggle("watching", !mine);
  const key = [mine, asking, operator, browsers].join();
  if (at("role").dataset.key === key) return;
  at("role").dataset.key = key;
  if (page.asked && !mine && asking !== page.bench.you) notify(`Browser ${operator} keeps control; you can ask again`);
  page.asked = asking === page.bench.you;
  const watching = operator ? `Browser ${operator} operates, you watch` : "Nobody operates";
  const parts = [make("b", { textContent: mine ? "You operate" : watching })];
  if (browsers > 1) parts.push(make("span", { textContent: ` (${browsers} browsers)` }));
  parts.push(" ");
  const button = (text, act) => parts.push(make("button", { textContent: text, onclick: act }));
  if (!mine && !asking) button("Take over", () => order("ask"));
  if (page.asked) parts.push("Control requested; wait at most 10 s");
  if (mine && asking) {
    button(`Hand over to browser ${asking}`, () => order("hand over", { yes: true }));
    button("Keep", () => order("hand over", { yes: false }));
  }
  at("role").replaceChildren(...parts);
}

function lost(reason) {
  document.body.classList.add("lost");
  at("state").textContent = "not connected";
  notices.keep(`not connected${reason ? `: ${reason}` : ""}; trying again`);
}

function askToken() {
  const dialog = at("token");
  const input = dialog.querySelector("input");
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => resolve(input.value);
  });
}

// Whether the bench has a view.
function offered(name) {
  if (name.startsWith("desk ")) return Boolean(page.desks?.layouts[Number(name.slice(5))]);
  const known = VIEWS.find((one) => one.name === name) ?? fixedKinds().find(({ kind }) => kind === name);
  return Boolean(known) && (known.offered?.(page.bench) ?? true);
}

async function choose(wanted) {
  const name = [wanted, wanted === "learning" ? "improve" : "scope", "scope"].find(offered);
  view = name;
  page.bench.choices.set("view", name);
  const isDesk = name.startsWith("desk ");
  if (isDesk) page.desks.current = Number(name.slice(5));
  for (const one of at("sections").children) one.hidden = one.id !== (isDesk ? "desks" : name);
  const timed = isDesk || name === "scope";
  for (const id of ["timebar", "signals", "figures"]) at(id).hidden = !timed;
  for (const tab of document.querySelectorAll("[role=tab]")) {
    tab.setAttribute("aria-selected", tab.dataset.view === name);
    tab.tabIndex = tab.dataset.view === name ? 0 : -1;
  }
  try {
    await load(name);
  } catch (wrong) {
    page.views.delete(name);
    notify(`The view ${name} cannot be loaded; open it again: ${wrong.message}`);
  }
  page.desks?.desks.forEach((desk) => (desk.element.hidden = desk !== shownDesk()));
  const none = shownView()?.table ? "" : "this view has no data yet";
  for (const button of [at("png"), at("csv")]) refuse(button, none);
}

// Saves the open view as a file: a picture, or its values as CSV.
async function save(kind) {
  const { bench, store } = page;
  const shown = shownView();
  const desk = shownDesk();
  const name = `${bench.title.replace(/\W+/g, "-")}-${view.replace(" ", "-")}-${timeStamp()}.${kind}`;
  const { csv, picture } = await import("./picture.js");
  const title = `${bench.title}, ${desk?.layout.name ?? view}, ${new Date().toLocaleString()}, tick ${store.newest}`;
  const draw = () => picture(desk?.element ?? at(view), [[[title]], ...(shown.words?.() ?? [])]);
  download(name, kind === "csv" ? new Blob([csv(shown.table())], { type: "text/csv" }) : await draw());
  notices.show(`saved as ${name}`, SHORT_NOTICE_MS);
}

// Returns the local date and time for the name of a file, such as 20261130-132200.
function timeStamp() {
  const now = new Date();
  const parts = [now.getFullYear(), now.getMonth() + 1, now.getDate(), now.getHours(), now.getMinutes(), now.getSeconds()];
  const digits = parts.map((part) => String(part).padStart(2, "0"));
  return `${digits.slice(0, 3).join("")}-${digits.slice(3).join("")}`;
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
  b: async () => {
    if (await page?.parameters.rollBack()) notify("The previous parameters are active again. Press B to undo this.");
  },
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
    const keyed = VIEWS.find(({ key }) => key === event.key);
    const act = KEYS[event.key.toLowerCase()] ?? (keyed && (() => page && choose(keyed.name)));
    if (act) {
      event.preventDefault();
      act();
    } else if (event.target.role === "tab") turnTab(event);
  },
  true,
);

// Moves from tab to tab with the arrow keys.
function turnTab(event) {
  const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!way) return;
  const all = [...document.querySelectorAll("[role=tab]")].filter((tab) => !tab.hidden);
  const next = all[(all.indexOf(event.target) + way + all.length) % all.length];
  const { view: wanted } = next.dataset;
  choose(wanted);
  document.querySelector(`[role=tab][data-view="${wanted}"]`).focus();
}

function draw() {
  requestAnimationFrame(draw); // first, so that an error in a view does not end the drawing
  shownView()?.draw?.();
  if (!at("signals").hidden) page?.list?.draw();
}

// Lists the tabs of the views that the bench has.
function tabs() {
  const tab = (name, text, title = "") => {
    const button = make("button", { textContent: text, title, role: "tab", onclick: () => choose(name) });
    button.dataset.view = name;
    return button;
  };
  const word = (name) => name.charAt(0).toUpperCase() + name.slice(1);
  at("tabs").replaceChildren(
    ...VIEWS.filter(({ name }) => offered(name)).map(({ name, key }) => tab(name, `${key} ${word(name)}`)),
    ...fixedKinds().map(({ kind, title, hint }) => tab(kind, title, hint)),
  );
}

at("png").onclick = () => save("png");
at("csv").onclick = () => save("csv");
at("theme").onclick = turnTheme;
at("stop").onclick = stop;
theme(kept.get("theme", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
draw();
