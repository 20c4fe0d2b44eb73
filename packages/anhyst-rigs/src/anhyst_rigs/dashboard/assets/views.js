// The views and the kinds of panels, in the order of their tabs and menus. The browser loads the code of each
// when the user first opens it.

import { register } from "./panels.js";
import { phaseColumn } from "./signals.js";

const hasCommands = (bench) => bench.commands.length > 0; // a foreign firmware has none
const levitates = (bench) => hasCommands(bench) && bench.aim.unit === "m" && phaseColumn(bench) >= 0;
const hasBoth = (bench) => Boolean(bench.learns && bench.limits); // learning and improvement have separate views

const improve = async (place, { bench, order }) => new (await import("./improve.js")).Improve(place, bench, order);
const learning = async (place, { bench, order }) => new (await import("./learn.js")).Learning(place, bench, order);

// Each view: name and key; `offered`: whether a bench has it, all have it if this is missing; `make`: returns a
// promise of the view in an element. The page itself makes the views without `make`.
export const VIEWS = [
  { name: "scope", key: "1" },
  {
    name: "loop",
    key: "2",
    offered: hasCommands,
    make: async (place, { bench, store }) => new (await import("./loop.js")).LoopView(place, bench, store),
  },
  {
    name: "steps",
    key: "3",
    make: async (place, { bench, finder }) => new (await import("./steps.js")).StepView(place, bench, finder),
  },
  {
    name: "parameters",
    key: "4",
    make: async (place, { parameters, order }) => new (await import("./sets.js")).Sets(place, parameters, order),
  },
  { name: "log", key: "5" },
  {
    name: "improve",
    key: "6",
    offered: (bench) => hasCommands(bench) && Boolean(bench.limits || bench.learns || bench.keeps_time),
    make: (place, context) => (context.bench.learns && !hasBoth(context.bench) ? learning : improve)(place, context),
  },
  {
    name: "levitation",
    key: "7",
    offered: levitates,
    make: async (place, { bench, store }) => new (await import("./levitation.js")).LevitationView(place, bench, store),
  },
  {
    name: "spectrum",
    key: "8",
    make: async (place, { bench, store }) => new (await import("./spectrum.js")).SpectrumView(place, bench, store),
  },
  { name: "learning", key: "9", offered: hasBoth, make: learning },
  {
    name: "body",
    key: "0",
    offered: (bench) => Boolean(bench.body),
    make: async (place, { bench, store }) => new (await import("./body.js")).BodyView(place, bench, store),
  },
];

const instrument = (name) => async (...given) => (await import("./instruments.js"))[name](...given);

register({ kind: "plot", title: "Plot", size: [6, 6], make: instrument("plot") });
register({ kind: "loop", title: "X-Y loop", size: [4, 5], make: instrument("loop") });
register({ kind: "number", title: "Number", size: [3, 2], make: instrument("number") });
register({ kind: "gauge", title: "Gauge", size: [3, 2], make: instrument("gauge") });
register({ kind: "table", title: "Table", size: [5, 4], make: instrument("table") });
register({
  kind: "slider",
  title: "Slider",
  size: [4, 2],
  make: async (...given) => (await import("./slider.js")).slider(...given),
});
register({
  kind: "bode",
  title: "Bode",
  hint: "Frequency response",
  size: [8, 9],
  fixed: true,
  offered: (bench) => Boolean(bench.response),
  make: async (...given) => new (await import("./bode.js")).BodePanel(...given),
});
register({
  kind: "catalogue",
  title: "Variables",
  size: [8, 6],
  fixed: true,
  offered: (bench) => Boolean(bench.catalogue),
  make: async (...given) => (await import("./catalogue.js")).catalogue(...given),
});
