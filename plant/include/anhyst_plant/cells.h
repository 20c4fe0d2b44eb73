/* SPDX-License-Identifier: Apache-2.0 */
/* Iron that consists of play cells (play operators). A cell follows the field with a play, and lags
   it by at most its threshold. The polarisation is the weighted sum of one anhysteretic curve at
   the fields of all cells:

        B = mu0*H + sum of weight*curve(h)

   Thresholds ascend, and all cells have had the same history since demagnetisation. Therefore, the
   first cells are the moving ones, and the cells at rest need no evaluation. */
#ifndef ANHYST_PLANT_CELLS_H
#define ANHYST_PLANT_CELLS_H

#include "anhyst_plant/curve.h"

#define ANHYST_PLANT_MAX_CELLS 64

typedef struct {
  int cells;                                /* 1..ANHYST_PLANT_MAX_CELLS */
  double threshold[ANHYST_PLANT_MAX_CELLS]; /* thresholds, A/m, ascending; the first may be 0 */
  double weight[ANHYST_PLANT_MAX_CELLS];    /* weight of each cell; their sum is one */
  anhyst_plant_curve curve;
} anhyst_plant_cell_steel;

typedef struct {
  double place[ANHYST_PLANT_MAX_CELLS];    /* fields of the cells, A/m */
  double rest[ANHYST_PLANT_MAX_CELLS + 1]; /* polarisation of this cell and all later cells, T */
} anhyst_plant_cells;

typedef struct {
  int moved;                           /* number of moving cells, which are the first ones */
  double part[ANHYST_PLANT_MAX_CELLS]; /* contribution of each moving cell to the polarisation, T */
} anhyst_plant_cells_goal;

#endif
