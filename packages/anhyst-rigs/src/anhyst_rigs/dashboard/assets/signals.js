// Finds the column of a signal in the rows of the bench.

// Returns the column of a signal, or -1 if it does not exist.
export function columnOf(bench, name) {
  return bench.signals.findIndex((signal) => signal.name === name);
}
