/* SPDX-License-Identifier: Apache-2.0 */
/* Derivatives of a path of play cells, forward mode, double precision. */
#ifndef ANHYST_CELL_SENSITIVITY_H
#define ANHYST_CELL_SENSITIVITY_H

#include "anhyst/law/cells.h"
#include "anhyst/law/sensitivity.h"

#ifdef __cplusplus
extern "C" {
#endif

/* By what is differentiated, beside the drive: the derivatives of weights, widths and thresholds,
   for every direction. */
typedef struct {
  const double *weight_t;    /* `cells` times `widths` rows of directions */
  const double *width_t;     /* `widths` rows of directions */
  const double *threshold_t; /* `cells` rows of directions; the first is zero */
} anhyst_cell_directions_f64;

/* Follows the drive as anhyst_cells_solve_f64 does, sample by sample, and beside it every tangent,
   by the implicit function theorem: x_t = (r_t - omega_t*m - omega*m_fixed)/(1 + omega*dm/dx), with
   the places of moving cells a threshold behind x_t, and those of cells at rest as they were left.
   numbers_t holds a row for each direction, the derivatives of x and p_1..p_n, and is advanced, as
   is the state; rest is space for as many numbers as there are directions. x, m: n values; x_t,
   m_t: n rows of directions. Error against the derivative of the computed path: 1e-9 relative, away
   from jumps and from samples where a cell just begins to move.
   Returns a status as anhyst_cells_solve_f64 does, with *index the sample. */
anhyst_status anhyst_cells_sensitivity_f64(const anhyst_cells_f64 *cells,
                                           const anhyst_cell_weights_f64 *weights,
                                           const anhyst_cell_directions_f64 *directions,
                                           const anhyst_differentiated_drive_f64 *drive,
                                           anhyst_cells_state_f64 *state, double *numbers_t,
                                           double *rest, double *x, double *m, double *x_t,
                                           double *m_t, size_t *index);

#ifdef __cplusplus
}
#endif
#endif
