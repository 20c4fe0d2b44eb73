/* SPDX-License-Identifier: Apache-2.0 */
/* Magnetisation curves of the play cells. */
#ifndef ANHYST_CELL_SHAPE_H
#define ANHYST_CELL_SHAPE_H

#include "anhyst/law/cells.h"

typedef struct {
  double f, f1, f2;
} cell_jet;

/* Returns phi(z) and its derivatives, exact to rounding. */
cell_jet anhyst_cell_shape(anhyst_shape shape, double z);

/* Returns the curve of column j at a play, with derivatives with respect to play/width. *z
   determines the derivative with respect to the width: d(phi_j)/d(a_j) = -f1*z/a_j. */
cell_jet anhyst_cell_curve(const anhyst_cell_weights_f64 *weights, int j, double play, double *z);

#endif
