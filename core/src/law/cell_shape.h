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

#endif
