/* SPDX-License-Identifier: Apache-2.0 */
/* Iron made of pinned cells.

   A cell follows the field only when that has moved by more than its threshold (a play operator);
   the polarisation is the weighted sum of one anhysteretic curve at the fields of all cells:

     B = mu0*H + sum of weight*curve(h)

   Thresholds ascend, and all cells have had the same past since they were demagnetised; so the
   cells that move form the beginning of the row, and what rests is looked at no further. */
#ifndef ANHYST_PLANT_CELLS_H
#define ANHYST_PLANT_CELLS_H

#include "anhyst_plant/curve.h"

#define ANHYST_PLANT_CELLS 64

typedef struct {
  int cells;                            /* 1..ANHYST_PLANT_CELLS */
  double threshold[ANHYST_PLANT_CELLS]; /* A/m, ascending, the first may be 0 */
  double weight[ANHYST_PLANT_CELLS];    /* share of each cell; they add up to one */
  anhyst_plant_curve curve;
} anhyst_plant_cell_steel;

typedef struct {
  double place[ANHYST_PLANT_CELLS]; /* fields of the cells, A/m */
  double
      rest[ANHYST_PLANT_CELLS + 1]; /* what this cell and all beyond add to the polarisation, T */
} anhyst_plant_cells;

typedef struct {
  int moved;                       /* cells that move, the first ones */
  double part[ANHYST_PLANT_CELLS]; /* what each of them adds to the polarisation there, T */
} anhyst_plant_cells_goal;

#endif
