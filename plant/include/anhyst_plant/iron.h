/* SPDX-License-Identifier: Apache-2.0 */
/* Iron made of pinned cells, which is not a Jiles-Atherton material.

   A cell follows the field only when that has moved by more than its threshold (a play operator);
   the polarisation is the weighted sum of one anhysteretic curve at the fields of all cells:

     B = mu0*H + sum of weight*(sharp*h/sqrt(h^2 + knee_sharp^2) + slow*2/pi*atan(h/knee_slow))

   Thresholds ascend, and all cells have had the same past since they were demagnetised; so the
   cells that move form the beginning of the row, and what rests is looked at no further. */
#ifndef ANHYST_PLANT_IRON_H
#define ANHYST_PLANT_IRON_H

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_MU0 1.25663706143591729539e-6
#define ANHYST_PLANT_CELLS 64

typedef struct {
  int cells;                            /* 1..ANHYST_PLANT_CELLS */
  double threshold[ANHYST_PLANT_CELLS]; /* A/m, ascending, the first may be 0 */
  double weight[ANHYST_PLANT_CELLS];    /* share of each cell; they add up to one */
  double sharp;                         /* T */
  double knee_sharp;                    /* A/m */
  double slow;                          /* T */
  double knee_slow;                     /* A/m */
} anhyst_plant_steel;

/* All zero: demagnetised. */
typedef struct {
  double place[ANHYST_PLANT_CELLS]; /* fields of the cells, A/m */
  double
      rest[ANHYST_PLANT_CELLS + 1]; /* what this cell and all beyond add to the polarisation, T */
  double field;                     /* at the last move, A/m */
  double stride;                    /* by which the field moved then */
  double density;                   /* flux density, T */
} anhyst_plant_cells;

/* Where the field may move to. */
typedef struct {
  double field;                    /* A/m */
  double density;                  /* flux density there, T */
  int moved;                       /* cells that move, the first ones */
  double part[ANHYST_PLANT_CELLS]; /* what each of them adds to the polarisation there, T */
} anhyst_plant_goal;

/* The field H for which a*H + b*B(H) = r, for a > 0 and b >= 0, if the field moves there in a
   straight line; the memory is not touched. |a*H + b*B - r| <= tolerance. */
void anhyst_plant_field(const anhyst_plant_steel *steel, const anhyst_plant_cells *cells, double a,
                        double b, double r, double tolerance, anhyst_plant_goal *goal);

/* Moves there. */
void anhyst_plant_move(const anhyst_plant_steel *steel, anhyst_plant_cells *cells,
                       const anhyst_plant_goal *goal);

#ifdef __cplusplus
}
#endif
#endif
