/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law, as an implementation of the interface in law.h. */
#include "anhyst/law/law.h"

static int state_size(const void *law)
{
  const anhyst_cells_f64 *cells = law;
  return cells->cells;
}

static anhyst_status solve_step(const void *law, const anhyst_memory_f64 *state, double omega,
                                double r, anhyst_solution_f64 *found)
{
  const anhyst_status status =
      anhyst_cells_solve_f64(law, &state->cells, omega, r, &found->next.cells);
  if (status == ANHYST_OK) {
    found->x = found->next.cells.x;
    found->m = found->next.cells.m;
    found->slope = found->next.cells.derivatives.slope;
  }
  return status;
}

static void accept_step(const void *law, anhyst_memory_f64 *state, const anhyst_solution_f64 *found)
{
  anhyst_cells_accept_f64(law, &state->cells, &found->next.cells);
}

static void read_field_and_m(const void *law, const anhyst_memory_f64 *state, double *x, double *m)
{
  (void)law;
  *x = state->cells.x;
  *m = state->cells.m;
}

static anhyst_status set_state(const void *law, const double *given, anhyst_memory_f64 *state)
{
  anhyst_cells_enter_f64(law, given, &state->cells);
  return ANHYST_OK;
}

static void read_state_numbers(const void *law, const anhyst_memory_f64 *state, double *found)
{
  anhyst_cells_numbers_f64(law, &state->cells, found);
}

const anhyst_law_f64 anhyst_law_cells_f64 = {
    state_size, solve_step, accept_step, read_field_and_m, set_state, read_state_numbers, 0};
