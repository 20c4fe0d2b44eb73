// The kinds of panels on a desk, and the interface of a panel.
//
// A kind is an object:
//   kind      key in the saved layout, such as "gauge"
//   title     name in the menu and in the head of the panel, in sentence case
//   hint      tooltip of a fixed tab; optional
//   size      [columns, rows] of a new panel on the grid of 12 columns
//   make(context, settings, save)   returns a promise of a panel; `settings` is a JSON object that the layout
//             stores, {} for a new panel; after a change, the panel calls save({ ...settings }) with all its settings
//
// The context is the same for all panels:
//   bench       the bench message of the server; bench.signals have name, label, symbol, unit, colour, column, head
//   store       the samples: store.count rows, store.value(column, row), store.tick(row), store.find(tick)
//   scope       the common time: scope.window (s), scope.view {from, to} (ticks)
//   parameters  active values and put(values)
//   order(what, fields)   sends an order; returns its answer, or null after a refusal that the page has shown
//   notify(text)          shows one line to the user and writes it into the log
//   status      the newest status message, null before the first
//
// A panel has:
//   element   its content; its size follows from the grid, and a canvas in a <figure> fills it
// and, if it needs them:
//   draw()          called in every frame while the panel is visible
//   status(status)  called for each status message (10 per second); status.refused gives the reason for each order
//   drop(name)      a signal was dropped on the panel
//   tools           elements in the head of the panel, such as a selection
//   table(), words()   columns of values in SI units for CSV, and lines of [text, colour] parts for PNG
//   plot            a TimePlot, which the common time draws
//
// views.js registers each kind. A kind of which there is one panel with many controls can also be a fixed tab:
// main.js shows it with `fixed: true`. A kind with offered(bench) exists only for the benches for which this is true.

const KINDS = new Map();

export function register(kind) {
  KINDS.set(kind.kind, kind);
}

export function kindOf(name) {
  return KINDS.get(name);
}

// Returns the kinds that a bench has.
export function kinds(bench) {
  return [...KINDS.values()].filter(({ offered }) => offered?.(bench) ?? true);
}
