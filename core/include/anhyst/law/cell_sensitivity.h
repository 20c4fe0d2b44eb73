/* SPDX-License-Identifier: Apache-2.0 */
/* Parameter derivatives of a path of play cells, in forward mode and double precision. */
#ifndef ANHYST_CELL_SENSITIVITY_H
#define ANHYST_CELL_SENSITIVITY_H

#include "anhyst/law/cells.h"
#include "anhyst/law/sensitivity.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Directions of differentiation in addition to the drive: the derivatives of weights, widths and
   thresholds for every direction. */
typedef struct {
  const double *weight_t;    /* `cells` times `widths` rows of directions */
  const double *width_t;     /* `widths` rows of directions */
  const double *threshold_t; /* `cells` rows of directions; the first is zero */
} anhyst_cell_directions_f64;

/* Follows the drive sample by sample like anhyst_cells_solve_f64, and computes every tangent by the
   implicit function theorem: x_t = (r_t - omega_t*m - omega*m_fixed)/(1 + omega*dm/dx). The plays
   of moving cells follow x_t minus the derivative of their threshold; those of cells at rest keep
   their derivatives. numbers_t contains one row for each direction: the derivatives of x and
   p_1..p_n. State and numbers_t are advanced. rest is working storage of one number per direction.
   x, m: n values; x_t, m_t: n rows of directions. The relative error against the derivative of the
   computed path is 1e-9, except at jumps and at samples where a cell just starts to move.

   Returns a status like anhyst_cells_solve_f64, with the sample in *index. */
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
