/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/cell_sensitivity.h"

#include <string.h>

#include "cell_shape.h"
#include "cell_table.h"

typedef struct {
  const anhyst_cells_f64 *cells;
  const anhyst_cell_weights_f64 *weights;
  const anhyst_cell_directions_f64 *directions;
  size_t direction_count; /* number of directions */
} problem;

/* Adds the derivatives of a cell's contribution at a constant play to a sum, for each direction.
   Returns the slope of the contribution with respect to the play. */
static double add_fixed_play_terms(const problem *s, int cell, double play, double *sum)
{
  const anhyst_cell_weights_f64 *w = s->weights;
  double slope = 0.0;
  for (int j = 0; j < w->widths; j++) {
    const size_t index = (size_t)cell * (size_t)w->widths + (size_t)j;
    const double inverse = 1.0 / w->width[j];
    double z;
    const cell_jet phi = anhyst_cell_curve(w, j, play, &z);
    const double slope_term = w->weight[index] * inverse * phi.f1;
    const double *weight_t = s->directions->weight_t + index * s->direction_count;
    const double *width_t = s->directions->width_t + (size_t)j * s->direction_count;
    for (size_t t = 0; t < s->direction_count; t++) {
      sum[t] += weight_t[t] * phi.f - slope_term * z * width_t[t];
    }
    slope += slope_term;
  }
  return slope;
}

/* Returns the number of active cells. The cell with threshold 0 is always active. */
static int count_active_cells(const anhyst_cells_state_f64 *state)
{
  return state->active > 1 ? state->active : 1;
}

static void sum_resting_cells(const problem *s, const anhyst_cells_state_f64 *state,
                              const double *numbers_t, double *rest)
{
  const size_t cells = (size_t)s->cells->cells;
  memset(rest, 0, s->direction_count * sizeof *rest);
  for (int i = count_active_cells(state); i < s->cells->cells; i++) {
    const double slope = add_fixed_play_terms(s, i, state->play_position[i], rest);
    for (size_t t = 0; t < s->direction_count; t++) {
      rest[t] += slope * numbers_t[t * cells + (size_t)i];
    }
  }
}

/* Sets the derivatives of the plays of the active cells: the derivative of x, minus the derivative
   of the threshold in the direction of travel. */
static void store_play_derivatives(const problem *s, const anhyst_cells_state_f64 *state,
                                   double *numbers_t)
{
  const size_t cells = (size_t)s->cells->cells;
  for (size_t t = 0; t < s->direction_count; t++) {
    for (int i = 1; i < state->active; i++) {
      numbers_t[t * cells + (size_t)i] =
          numbers_t[t * cells] -
          state->direction * s->directions->threshold_t[(size_t)i * s->direction_count + t];
    }
  }
}

/* Differentiates at the new state. On entry, m_t contains the derivatives for the cells at rest. */
static void differentiate_step(const problem *s, const anhyst_cells_state_f64 *state, double omega,
                               const double *omega_t, const double *r_t, double *numbers_t,
                               double *x_t, double *m_t)
{
  const size_t cells = (size_t)s->cells->cells;
  double slope = state->derivatives.slope;
  for (int i = 0; i < count_active_cells(state); i++) {
    const double cell_slope =
        add_fixed_play_terms(s, i, state->x - state->direction * s->cells->threshold[i], m_t);
    slope = state->active == 0 ? cell_slope : slope;
    for (size_t t = 0; i > 0 && t < s->direction_count; t++) {
      m_t[t] -= cell_slope * state->direction *
                s->directions->threshold_t[(size_t)i * s->direction_count + t];
    }
  }
  const double inverse = 1.0 / (1.0 + omega * slope);
  for (size_t t = 0; t < s->direction_count; t++) {
    x_t[t] = (r_t[t] - omega_t[t] * state->m - omega * m_t[t]) * inverse;
    m_t[t] += slope * x_t[t];
    numbers_t[t * cells] = x_t[t];
  }
}

anhyst_status anhyst_cells_sensitivity_f64(const anhyst_cells_f64 *cells,
                                           const anhyst_cell_weights_f64 *weights,
                                           const anhyst_cell_directions_f64 *directions,
                                           const anhyst_differentiated_drive_f64 *drive,
                                           anhyst_cells_state_f64 *state, double *numbers_t,
                                           double *rest, double *x, double *m, double *x_t,
                                           double *m_t, size_t *index)
{
  const size_t count = drive->directions;
  const problem s = {cells, weights, directions, count};
  sum_resting_cells(&s, state, numbers_t, rest);
  for (size_t i = 0; i < drive->n; i++) {
    anhyst_cells_candidate_f64 next;
    const anhyst_status status =
        anhyst_cells_solve_f64(cells, state, drive->omega[i], drive->r[i], &next);
    if (status != ANHYST_OK) {
      *index = i;
      return status;
    }
    const int is_reversed = next.direction * state->direction <= 0.0;
    const int is_row_changed = is_reversed || next.active != state->active;
    if (is_reversed) {
      store_play_derivatives(&s, state, numbers_t);
    }
    anhyst_cells_accept_f64(cells, state, &next);
    if (is_row_changed) {
      sum_resting_cells(&s, state, numbers_t, rest);
    }
    memcpy(m_t + i * count, rest, count * sizeof *rest);
    differentiate_step(&s, state, drive->omega[i], drive->omega_t + i * count,
                       drive->r_t + i * count, numbers_t, x_t + i * count, m_t + i * count);
    x[i] = state->x;
    m[i] = state->m;
  }
  store_play_derivatives(&s, state, numbers_t);
  return ANHYST_OK;
}
