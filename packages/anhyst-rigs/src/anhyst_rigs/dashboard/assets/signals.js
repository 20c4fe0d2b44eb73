// Where a signal of the bench stands in its rows.

// The column of a signal, or -1 where there is none.
export function columnOf(bench, name) {
  return bench.signals.findIndex((signal) => signal.name === name);
}
