/* SPDX-License-Identifier: Apache-2.0 */
/* Steady-state cycles, in a separate file because their 35 kB of stack are only for a PC. */
#include <math.h>

#include "anhyst/law/circuit.h"

/* Reads the numbers of all hysteresis states one after the other. Returns the total count. */
static int read_numbers(const anhyst_iron_f64 *iron, const anhyst_memory_f64 *state,
                        double *numbers)
{
  const int memories = anhyst_hysteresis_memories_f64(iron);
  const int numbers_per_memory = iron->law->numbers(iron->parameters);
  int count = 0;
  for (int i = 0; i < memories; i++) {
    iron->law->leave(iron->parameters, &state[i], numbers + count);
    count += numbers_per_memory;
  }
  if (anhyst_memories_f64(iron) > memories) {
    numbers[count++] = state[memories].flux * iron->state_scale; /* saturation is about 1 T */
  }
  return count;
}

/* Extrapolates the repeated cycles to their limit, for one hysteresis state after the other. */
static void extrapolate_states(const anhyst_iron_f64 *iron, const double *const ends[3],
                               anhyst_memory_f64 *state)
{
  const int memories = anhyst_hysteresis_memories_f64(iron);
  const int numbers_per_memory = iron->law->numbers(iron->parameters);
  for (int i = 0; i < memories; i++) {
    const ptrdiff_t at = (ptrdiff_t)i * numbers_per_memory;
    const double *const memory_ends[3] = {ends[0] + at, ends[1] + at, ends[2] + at};
    iron->law->hasten(iron->parameters, memory_ends, &state[i]);
  }
}

static int is_periodic(int count, const double *old_numbers, const double *new_numbers, double tol)
{
  for (int i = 0; i < count; i++) {
    if (!(fabs(new_numbers[i] - old_numbers[i]) <= tol)) {
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
  double ends[4][ANHYST_NUMBERS_MAX * ANHYST_MEMORIES_MAX] = {{0}}; /* states at ends of cycles */
  int newest = 0;
  const int count = read_numbers(iron, state, ends[0]);
  for (*cycles = 1; *cycles <= most_cycles; (*cycles)++) {
    const anhyst_status status =
        anhyst_record_f64(iron, state, inverse, n, given, rho, eddy, 0, 0, index);
    if (status != ANHYST_OK) {
      return status;
    }
    const double *before = ends[newest];
    newest = (newest + 1) % 4;
    read_numbers(iron, state, ends[newest]);
    if (is_periodic(count, before, ends[newest], tol * iron->state_scale)) {
      return ANHYST_OK;
    }
    if (newest == 0 && iron->law->hasten != 0) {
      const double *const last_ends[3] = {ends[2], ends[3], ends[0]};
      extrapolate_states(iron, last_ends, state);
      read_numbers(iron, state, ends[0]);
    }
  }
  return ANHYST_NOT_SETTLED;
}
