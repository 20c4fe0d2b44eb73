/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/cell_sensitivity.h"

#include <string.h>

#include "cell_shape.h"
#include "cell_table.h"

/* What stays the same along a record. */
typedef struct {
  const anhyst_cells_f64 *cells;
  const anhyst_cell_weights_f64 *weights;
  const anhyst_cell_directions_f64 *by;
  size_t count; /* of directions */
} setting;

/* Adds to sum what a cell's contribution changes by while its place is held, direction by
   direction; returns its slope over the place. */
static double add_held(const setting *s, int cell, double place, double *sum)
{
  const anhyst_cell_weights_f64 *w = s->weights;
  double slope = 0.0;
  for (int j = 0; j < w->widths; j++) {
    const size_t at = (size_t)cell * (size_t)w->widths + (size_t)j;
    const double inverse = 1.0 / w->width[j];
    double z;
    const cell_jet phi = anhyst_cell_curve(w, j, place, &z);
    const double steep = w->weight[at] * inverse * phi.f1;
    const double *weight_t = s->by->weight_t + at * s->count;
    const double *width_t = s->by->width_t + (size_t)j * s->count;
    for (size_t t = 0; t < s->count; t++) {
      sum[t] += weight_t[t] * phi.f - steep * z * width_t[t];
    }
    slope += steep;
  }
  return slope;
}

/* Cells that move; the one without a threshold always does. */
static int moving(const anhyst_cells_state_f64 *state)
{
  return state->active > 1 ? state->active : 1;
}

/* The cells at rest, all together. */
static void sum_rest(const setting *s, const anhyst_cells_state_f64 *state, const double *numbers_t,
                     double *rest)
{
  const size_t cells = (size_t)s->cells->cells;
  memset(rest, 0, s->count * sizeof *rest);
  for (int i = moving(state); i < s->cells->cells; i++) {
    const double slope = add_held(s, i, state->place[i], rest);
    for (size_t t = 0; t < s->count; t++) {
      rest[t] += slope * numbers_t[t * cells + (size_t)i];
    }
  }
}

/* Gives the places of the cells that move the derivative of x, less that of their threshold. */
static void leave_moving(const setting *s, const anhyst_cells_state_f64 *state, double *numbers_t)
{
  const size_t cells = (size_t)s->cells->cells;
  for (size_t t = 0; t < s->count; t++) {
    for (int i = 1; i < state->active; i++) {
      numbers_t[t * cells + (size_t)i] =
          numbers_t[t * cells] - state->direction * s->by->threshold_t[(size_t)i * s->count + t];
    }
  }
}

/* Derivatives at the place that the state has reached; m_t holds what those at rest add. */
static void differentiate(const setting *s, const anhyst_cells_state_f64 *state, double omega,
                          const double *omega_t, const double *r_t, double *numbers_t, double *x_t,
                          double *m_t)
{
  const size_t cells = (size_t)s->cells->cells;
  double slope = state->bend.slope;
  for (int i = 0; i < moving(state); i++) {
    const double at = add_held(s, i, state->x - state->direction * s->cells->threshold[i], m_t);
    slope = state->active == 0 ? at : slope;
    for (size_t t = 0; i > 0 && t < s->count; t++) {
      m_t[t] -= at * state->direction * s->by->threshold_t[(size_t)i * s->count + t];
    }
  }
  const double inverse = 1.0 / (1.0 + omega * slope);
  for (size_t t = 0; t < s->count; t++) {
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
  const setting s = {cells, weights, directions, count};
  sum_rest(&s, state, numbers_t, rest);
  for (size_t i = 0; i < drive->n; i++) {
    anhyst_cells_candidate_f64 next;
    const anhyst_status status =
        anhyst_cells_solve_f64(cells, state, drive->omega[i], drive->r[i], &next);
    if (status != ANHYST_OK) {
      *index = i;
      return status;
    }
    const int turned = next.direction * state->direction <= 0.0;
    const int changed = turned || next.active != state->active;
    if (turned) {
      leave_moving(&s, state, numbers_t);
    }
    anhyst_cells_accept_f64(cells, state, &next);
    if (changed) {
      sum_rest(&s, state, numbers_t, rest);
    }
    memcpy(m_t + i * count, rest, count * sizeof *rest);
    differentiate(&s, state, drive->omega[i], drive->omega_t + i * count, drive->r_t + i * count,
                  numbers_t, x_t + i * count, m_t + i * count);
    x[i] = state->x;
    m[i] = state->m;
  }
  leave_moving(&s, state, numbers_t);
  return ANHYST_OK;
}
