/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law in double precision: play operators of the effective field, with curves. */
#ifndef ANHYST_CELLS_H
#define ANHYST_CELLS_H

#include <stddef.h>
#include <stdint.h>

#include "anhyst/numeric/status.h"

/* Maximum number of cells, including the cell with threshold 0. */
#define ANHYST_CELLS_MAX 64
#define ANHYST_CELLS_OCTAVES 60

#ifdef __cplusplus
extern "C" {
#endif

/* The curve phi of a cell: an odd function that rises to the limit 1. */
typedef enum { ANHYST_SHAPE_TANH = 0, ANHYST_SHAPE_LANGEVIN = 1 } anhyst_shape;

/* The law; all fields in A/m:

     p_i <- clip(p_i, x - r_i, x + r_i),   m = sum_i f_i(p_i),   f_i(p) = sum_j W_ij*phi_j(p),
     phi_j(p) = (phi((p - b_j)/a_j) + phi((p + b_j)/a_j))/2.

   The curve phi_j is odd because phi is odd. If the centres b_j and the widths a_j are closely
   spaced, f_i can be any odd rising function. The cells are then a discrete symmetric Preisach
   operator. */
typedef struct {
  int cells;               /* number of cells, 1..ANHYST_CELLS_MAX */
  int widths;              /* number of widths, 1 or more */
  const double *threshold; /* thresholds r_i, ascending from 0 */
  const double *width;     /* widths a_j, above 0 */
  const double *weight;    /* weights W_ij >= 0, at least one > 0: `cells` rows of `widths` */
  anhyst_shape shape;
  const double *centre; /* centres b_j, 0 or above; NULL: all are 0 */
} anhyst_cell_weights_f64;

/* A quintic polynomial on one table interval. */
typedef struct {
  double c[6]; /* polynomial coefficients; the variable is 0 at the end near x = 0, 1 at the
                  other */
} anhyst_cell_piece_f64;

/* The law as a table, so that a step takes the same time for any number of cells. While x rises,
   the first m cells move with p_i = x - r_i. Row m - 1 contains the sum of these cells, T_m(x) =
   sum_{i<m} f_i(x - r_i). While x falls, the sum is -T_m(-x) by symmetry. All rows have the same
   intervals. Each octave of 1 + |x|/unit is divided into equal intervals (pieces). The number of
   intervals is a power of two, which depends on the curves in the octave. */
typedef struct {
  int cells;
  double threshold[ANHYST_CELLS_MAX];
  double saturation;     /* saturation magnetisation: the sum of all weights */
  double max_slope;      /* upper bound of dm/dx over all states */
  double reversal_slope; /* largest dm/dx just after a reversal, when only cell 0 moves */
  double x_max;          /* largest |x| of the table; there is no solution beyond it */
  double scale; /* widest curve plus largest threshold: reference of the tolerances for x */
  double max_cubic_step; /* longest step in x with a sufficiently accurate cubic polynomial */
  double inverse_unit;   /* 1/unit, m/A */
  double table_end;      /* end of the tables: largest 1 + |x|/unit */
  int octaves;
  int shift[ANHYST_CELLS_OCTAVES]; /* right shift of the bits of 1 + |x|/unit to an index */
  int64_t first[ANHYST_CELLS_OCTAVES];
  double intervals_per_unit[ANHYST_CELLS_OCTAVES]; /* intervals per unit, in each octave */
  int64_t pieces;                                  /* number of intervals on each side of zero */
  const anhyst_cell_piece_f64 *rows;               /* `cells` rows of 2*pieces polynomials */
} anhyst_cells_f64;

/* Derivatives of the sum of the moving cells with respect to x*direction, at a state. */
typedef struct {
  double slope, curve, third;
} anhyst_cells_bend_f64;

/* Hysteresis state, and data that shorten the next step. All members are 0 if demagnetised. */
typedef struct {
  double x;         /* effective field */
  double m;         /* magnetisation */
  double direction; /* direction of the last movement, +1 or -1; 0: no movement yet */
  double resting_m; /* sum of the cells at rest, times the direction */
  anhyst_cells_bend_f64 derivatives;
  int active;                             /* number of moving cells, which are the first ones */
  double play_position[ANHYST_CELLS_MAX]; /* p_i of a cell at rest; moving: x - direction*r_i */
} anhyst_cells_state_f64;

/* A trial step before its commit. Play positions of the state change only at a reversal. */
typedef struct {
  double x, m, direction, resting_m;
  anhyst_cells_bend_f64 derivatives;
  int active;
} anhyst_cells_candidate_f64;

/* Usual target error of the tables, as a fraction of the saturation. */
#define ANHYST_CELLS_AIM 1e-12

/* Selects the intervals of the tables so that the error of m is at most `aim` times the saturation,
   if possible. Sets *pieces to the total number of polynomials. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER. An error means: weights out of range, or curves that are too narrow
   compared with the thresholds (below about 1/300 of the largest). For such curves, not even an
   error of 1e-6 of the saturation is possible. */
anhyst_status anhyst_cells_lay_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                                   double aim, size_t *pieces);

/* Fills the rows. storage has the number of polynomials that anhyst_cells_lay_f64 returned, and
   must outlive the law. With ANHYST_CELLS_AIM, the error of m against the exact sums is 1e-12 of
   the saturation for curves down to 1/30 of the largest threshold. For narrower curves, the error
   rises with the sixth power of the ratio of threshold to width, up to 1e-6. On the ascending and
   the descending branch, the curve of a cell is interpolated in different intervals. Therefore, up
   to a fifth of that error is added in each minor loop, until all cells move or
   anhyst_cells_enter_f64 sets the state again. */
void anhyst_cells_tabulate_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                               anhyst_cell_piece_f64 *storage);

/* Sets a state from any x and p_1..p_n (`cells` numbers). Limits x to -x_max..x_max (0 for NaN),
   and each p_i to its allowed distance from p of the cell before. Keeps a valid state. */
void anhyst_cells_enter_f64(const anhyst_cells_f64 *cells, const double *numbers,
                            anhyst_cells_state_f64 *state);

/* Sets `numbers` to x and p_1..p_n of a state. */
void anhyst_cells_numbers_f64(const anhyst_cells_f64 *cells, const anhyst_cells_state_f64 *state,
                              double *numbers);

/* Solves x + omega*m(x) = r (omega dimensionless, r in A/m) for the first x that a monotone path
   from the state reaches. Does not change the state. With 1 + omega*max_slope > 0, the solution is
   unique. If 1 + omega*max_slope is 0 or less, m may jump: the search follows the row interval by
   interval and returns the first solution. If 1 + omega*reversal_slope <= 0, every reversal would
   jump, and the result is ANHYST_REFUSED. Error: |x + omega*m - r| is within 8 ulp of |x| + |r| +
   |omega|*saturation. Returns ANHYST_OK, ANHYST_REFUSED, ANHYST_OUT_OF_RANGE or
   ANHYST_NOT_CONVERGED. The candidate is valid only with ANHYST_OK. */
anhyst_status anhyst_cells_solve_f64(const anhyst_cells_f64 *cells,
                                     const anhyst_cells_state_f64 *state, double omega, double r,
                                     anhyst_cells_candidate_f64 *candidate);

/* Commits a solution to the state from which it was found. */
void anhyst_cells_accept_f64(const anhyst_cells_f64 *cells, anhyst_cells_state_f64 *state,
                             const anhyst_cells_candidate_f64 *candidate);

#ifdef __cplusplus
}
#endif
#endif
