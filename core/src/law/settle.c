/* SPDX-License-Identifier: Apache-2.0 */
/* Settled cycles. A file of its own: its 35 kB of stack are for a PC. */
#include <math.h>

#include "anhyst/law/circuit.h"

/* The numbers of all memories, one after the other; returns how many there are. */
static int leave(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state, double *numbers)
{
  const int memories = anhyst_memories_f64(iron);
  const int each = iron->law->numbers(iron->parameters);
  for (int i = 0; i < memories; i++) {
    iron->law->leave(iron->parameters, &state[i], numbers + (ptrdiff_t)i * each);
  }
  return memories * each;
}

/* Guesses where repetitions lead to, memory by memory. */
static void hasten(const anhyst_iron_f64 *iron, const double *const ends[3],
                   anhyst_memory_f64 *state)
{
  const int memories = anhyst_memories_f64(iron);
  const int each = iron->law->numbers(iron->parameters);
  for (int i = 0; i < memories; i++) {
    const ptrdiff_t at = (ptrdiff_t)i * each;
    const double *const own[3] = {ends[0] + at, ends[1] + at, ends[2] + at};
    iron->law->hasten(iron->parameters, own, &state[i]);
  }
}

/* Whether every number of a state has returned. */
static int returned(int count, const double *before, const double *after, double tol)
{
  for (int i = 0; i < count; i++) {
    if (!(fabs(after[i] - before[i]) <= tol)) {
      return 0;
    }
  }
  return 1;
}

anhyst_status anhyst_settle_f64(const anhyst_iron_f64 *iron, anhyst_memory_f64 *state, int inverse,
                                size_t n, const double *given, const double *rho,
                                const double *eddy, double tol, int most_cycles, int *cycles,
                                size_t *index)
{
  double ends[4][ANHYST_NUMBERS_MAX * ANHYST_MEMORIES_MAX] = {{0}}; /* since the last guess */
  int fresh = 0;
  const int count = leave(iron, state, ends[0]);
  for (*cycles = 1; *cycles <= most_cycles; (*cycles)++) {
    const anhyst_status status =
        anhyst_record_f64(iron, state, inverse, n, given, rho, eddy, 0, 0, index);
    if (status != ANHYST_OK) {
      return status;
    }
    const double *before = ends[fresh];
    fresh = (fresh + 1) % 4;
    leave(iron, state, ends[fresh]);
    if (returned(count, before, ends[fresh], tol * iron->grain)) {
      return ANHYST_OK;
    }
    if (fresh == 0 && iron->law->hasten != 0) {
      const double *const last[3] = {ends[2], ends[3], ends[0]};
      hasten(iron, last, state);
      leave(iron, state, ends[0]);
    }
  }
  return ANHYST_NOT_SETTLED;
}
