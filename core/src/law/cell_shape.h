/* SPDX-License-Identifier: Apache-2.0 */
/* The curves that cells contribute. */
#ifndef ANHYST_CELL_SHAPE_H
#define ANHYST_CELL_SHAPE_H

#include "anhyst/law/cells.h"

/* Value, slope and curvature. */
typedef struct {
  double f, f1, f2;
} cell_jet;

/* phi(z), to rounding. */
cell_jet anhyst_cell_shape(anhyst_shape shape, double z);

/* Returns the curve of column j at a place, with derivatives over place/width. *z is what a change
   of the width acts on: d(phi_j)/d(a_j) = -f1*z/a_j. */
cell_jet anhyst_cell_curve(const anhyst_cell_weights_f64 *weights, int j, double place, double *z);

#endif
