/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law in double precision: play operators in the effective field with curves. */
#ifndef ANHYST_CELLS_H
#define ANHYST_CELLS_H

#include <stddef.h>
#include <stdint.h>

#include "anhyst/numeric/status.h"

/* Maximum number of cells, including the one without a threshold. */
#define ANHYST_CELLS_MAX 64
#define ANHYST_CELLS_OCTAVES 60

#ifdef __cplusplus
extern "C" {
#endif

/* The curve phi of a cell: odd, rising, with the limit 1. */
typedef enum { ANHYST_SHAPE_TANH = 0, ANHYST_SHAPE_LANGEVIN = 1 } anhyst_shape;

/* The law, all fields in A/m:

     p_i <- clip(p_i, x - r_i, x + r_i),   m = sum_i f_i(p_i),   f_i(p) = sum_j W_ij*phi_j(p),
     phi_j(p) = (phi((p - b_j)/a_j) + phi((p + b_j)/a_j))/2.

   The curve phi_j is odd, as phi is. With centres b_j and widths a_j on a fine grid, f_i can be any
   odd rising function. The cells are then a discrete symmetric Preisach operator. */
typedef struct {
  int cells;               /* 1..ANHYST_CELLS_MAX */
  int widths;              /* 1 or more */
  const double *threshold; /* r_i, ascending from 0 */
  const double *width;     /* a_j, above 0 */
  const double *weight;    /* W_ij, `cells` rows of `widths`, none below 0, at least one above 0 */
  anhyst_shape shape;
  const double *centre; /* b_j, 0 or above; NULL: all 0 */
} anhyst_cell_weights_f64;

/* A quintic piece. */
typedef struct {
  double c[6]; /* coefficients of powers of the position, 0 to 1 away from zero */
} anhyst_cell_piece_f64;

/* The law as a table, so that a step takes the same time for any number of cells. While x rises,
   the first m cells move with p_i = x - r_i. Row m - 1 contains their sum T_m(x) = sum_{i<m} f_i(x
   - r_i). While x falls, their sum is -T_m(-x) by symmetry. All rows have the same nodes: each
   octave of 1 + |x|/unit is divided into equal pieces. Their number is a power of two that depends
   on the curves in the octave. */
typedef struct {
  int cells;
  double threshold[ANHYST_CELLS_MAX];
  double saturation; /* sum of all weights */
  double steepest;   /* upper bound of dm/dx over all states */
  double reversible; /* largest dm/dx just after a reversal, that of cell 0 */
  double reach;      /* largest |x|; no solution beyond it */
  double scale;      /* widest curve plus largest threshold: reference of tolerances for x */
  double tangent;    /* step in x for which three derivatives are as accurate as the curve */
  double per_unit;
  double top; /* end of the tables, as 1 + |x|/unit */
  int octaves;
  int shift[ANHYST_CELLS_OCTAVES]; /* right shift from position bits to piece index */
  int64_t first[ANHYST_CELLS_OCTAVES];
  double per_piece[ANHYST_CELLS_OCTAVES]; /* pieces per unit */
  int64_t pieces;                         /* number of pieces on each side of zero */
  const anhyst_cell_piece_f64 *rows;      /* `cells` rows of 2*pieces */
} anhyst_cells_f64;

/* Derivatives of the sum of the moving cells over x*direction at a state. */
typedef struct {
  double slope, curve, third;
} anhyst_cells_bend_f64;

/* State, and data that shorten the next step. All zeros is the demagnetised state. */
typedef struct {
  double x;         /* effective field */
  double m;         /* magnetisation */
  double direction; /* of the last movement, +1 or -1; 0: none */
  double rest;      /* sum of the cells at rest, times the direction */
  anhyst_cells_bend_f64 bend;
  int active;                     /* number of moving cells, the first ones */
  double place[ANHYST_CELLS_MAX]; /* p_i of cells at rest; others: x - direction*r_i */
} anhyst_cells_state_f64;

/* A trial step before its commit: the state without the places, which change only at a reversal. */
typedef struct {
  double x, m, direction, rest;
  anhyst_cells_bend_f64 bend;
  int active;
} anhyst_cells_candidate_f64;

/* Target error of the tables, as a fraction of the saturation. */
#define ANHYST_CELLS_AIM 1e-12

/* Selects the nodes of the tables so that the error of m is at most `aim` times the saturation
   where possible. Sets *pieces to the total number of pieces of all rows. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER: weights out of range, or curves so narrow compared with the thresholds
   (below about 1/300 of the largest) that even an error of 1e-6 of the saturation is not
   possible. */
anhyst_status anhyst_cells_lay_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                                   double aim, size_t *pieces);

/* Fills the rows. storage has as many pieces as anhyst_cells_lay_f64 has stated, and must outlive
   the law. With ANHYST_CELLS_AIM, the error of m against the exact sums is 1e-12 of the saturation
   for curves down to 1/30 of the largest threshold. For narrower curves it rises with the sixth
   power of that ratio to 1e-6. On the ascending and the descending branch, the curve of a cell is
   interpolated between different nodes. Therefore, up to a fifth of that error is added in each
   minor loop, until all cells move or the state is entered again. */
void anhyst_cells_tabulate_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                               anhyst_cell_piece_f64 *storage);

/* Sets a state from any x and p_1..p_n (`cells` numbers). x is limited to the reach (0 for NaN),
   and each place to the allowed distance from the place before. A valid state is not changed. */
void anhyst_cells_enter_f64(const anhyst_cells_f64 *cells, const double *numbers,
                            anhyst_cells_state_f64 *state);

/* Returns x and p_1..p_n of a state. */
void anhyst_cells_numbers_f64(const anhyst_cells_f64 *cells, const anhyst_cells_state_f64 *state,
                              double *numbers);

/* Solves x + omega*m(x) = r (omega dimensionless, r in A/m) for the first x that a monotone path
   from the state reaches. Does not change the state. With 1 + omega*steepest > 0, the solution is
   unique. Otherwise m may jump: the search follows the row piece by piece and returns the first
   solution. With 1 + omega*reversible <= 0, every reversal would jump: ANHYST_REFUSED. Error: |x +
   omega*m - r| is within 8 ulp of |x| + |r| + |omega|*saturation. Returns ANHYST_OK,
   ANHYST_REFUSED, ANHYST_OUT_OF_RANGE or ANHYST_NOT_CONVERGED; the candidate is valid only with
   ANHYST_OK. */
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
