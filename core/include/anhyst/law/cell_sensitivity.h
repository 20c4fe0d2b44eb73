/* SPDX-License-Identifier: Apache-2.0 */
/* Parameter derivatives of a path of play cells in double precision, by forward differentiation. */
#ifndef ANHYST_CELL_SENSITIVITY_H
#define ANHYST_CELL_SENSITIVITY_H

#include "anhyst/law/cells.h"
#include "anhyst/law/sensitivity.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Directions of differentiation, in addition to those of the drive. For every direction, the
   derivatives of the weights, widths and thresholds. */
typedef struct {
  const double *weight_t;    /* d(W_ij): `cells` times `widths` rows, a column for each direction */
  const double *width_t;     /* d(a_j): `widths` rows, a column for each direction */
  const double *threshold_t; /* d(r_i): `cells` rows, a column for each direction; row 0 is zero */
} anhyst_cell_directions_f64;

/* Follows the drive sample by sample like anhyst_cells_solve_f64. Computes the derivative in each
   direction (subscript t) by the implicit function theorem: x_t = (r_t - omega_t*m -
   omega*m_fixed)/(1 + omega*dm/dx). m_fixed is the derivative of m at constant x. The play position
   of a moving cell has the derivative x_t minus the derivative of its threshold. A cell at rest
   keeps its derivative. numbers_t has one row for each direction: the derivatives of x and
   p_1..p_n. `state` and numbers_t are advanced. rest is working storage: one number for each
   direction. x and m have n values, x_t and m_t n rows with one column for each direction. The
   relative error is 1e-9 against the derivative of the computed path, except at jumps and at
   samples where a cell just starts to move.

   Returns the status of anhyst_cells_solve_f64, with the sample in *index. */
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
