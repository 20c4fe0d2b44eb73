/* SPDX-License-Identifier: Apache-2.0 */
/* Play cells in the effective field: cells that follow it at a distance, and a sum of curves. */
#ifndef ANHYST_CELLS_H
#define ANHYST_CELLS_H

#include <stddef.h>
#include <stdint.h>

#include "anhyst/numeric/status.h"

/* Cells, the one without a threshold included. */
#define ANHYST_CELLS_MAX 64
#define ANHYST_CELLS_OCTAVES 60

#ifdef __cplusplus
extern "C" {
#endif

/* The curve phi that a cell contributes: odd, rising, 1 at the end. */
typedef enum { ANHYST_SHAPE_TANH = 0, ANHYST_SHAPE_LANGEVIN = 1 } anhyst_shape;

/* The law itself, A/m throughout:
     p_i <- clip(p_i, x - r_i, x + r_i),   m = sum_i f_i(p_i),   f_i(p) = sum_j W_ij*phi_j(p),
     phi_j(p) = (phi((p - b_j)/a_j) + phi((p + b_j)/a_j))/2.
   The curve phi_j is odd, as phi is. With centres b_j and widths a_j on a fine grid, f_i is any odd
   rising function. The cells are then a discrete symmetric Preisach operator. */
typedef struct {
  int cells;               /* 1..ANHYST_CELLS_MAX */
  int widths;              /* 1 or more */
  const double *threshold; /* r_i, ascending from 0 */
  const double *width;     /* a_j, above 0 */
  const double *weight;    /* W_ij, `cells` rows of `widths`, 0 or above, one at least above */
  anhyst_shape shape;
  const double *centre; /* b_j, 0 or above; NULL: all 0 */
} anhyst_cell_weights_f64;

/* A quintic piece. */
typedef struct {
  double c[6]; /* of powers of the place in the piece, 0 to 1 away from zero */
} anhyst_cell_piece_f64;

/* The law tabulated, so that a step costs the same for any number of cells. While x rises, the
   cells that move are the first m, with p_i = x - r_i, and add T_m(x) = sum_{i<m} f_i(x - r_i): row
   m - 1. While it falls, by symmetry, they add -T_m(-x). Nodes are those of all rows: each octave
   of 1 + |x|/unit is cut into a power of two of equal pieces, as many as the curves there need. */
typedef struct {
  int cells;
  double threshold[ANHYST_CELLS_MAX];
  double saturation; /* sum of all weights */
  double steepest;   /* upper bound of dm/dx over all states */
  double reversible; /* largest dm/dx just after a reversal, that of cell 0 */
  double reach;      /* largest |x|; beyond it nothing is solved */
  double scale;      /* widest curve and largest threshold: what a tolerance of x is a part of */
  double tangent;    /* a way so short that three derivatives are as good as the curve */
  double per_unit;
  double top; /* last place in the tables, as 1 + |x|/unit */
  int octaves;
  int shift[ANHYST_CELLS_OCTAVES]; /* from a place to its piece: bits to the right, */
  int64_t first[ANHYST_CELLS_OCTAVES];
  double per_piece[ANHYST_CELLS_OCTAVES]; /* pieces for each unit */
  int64_t pieces;                         /* on each side of zero */
  const anhyst_cell_piece_f64 *rows;      /* `cells` rows of 2*pieces */
} anhyst_cells_f64;

/* Derivatives of what the moving cells add, at the place of a state, over x*direction. */
typedef struct {
  double slope, curve, third;
} anhyst_cells_bend_f64;

/* State and what makes the next step short. All zero: demagnetised. */
typedef struct {
  double x;         /* effective field */
  double m;         /* magnetisation */
  double direction; /* of the last travel, +1 or -1; 0: none */
  double rest;      /* what the cells at rest add, times the direction */
  anhyst_cells_bend_f64 bend;
  int active;                     /* cells that move, the first ones */
  double place[ANHYST_CELLS_MAX]; /* p_i of those at rest; the others are x - direction*r_i */
} anhyst_cells_state_f64;

/* A solution that has not been committed: the state without the places, which do not change but
   where the direction does. */
typedef struct {
  double x, m, direction, rest;
  anhyst_cells_bend_f64 bend;
  int active;
} anhyst_cells_candidate_f64;

/* What tables aim at unless less will do, of the saturation. */
#define ANHYST_CELLS_AIM 1e-12

/* Lays the nodes of the tables so fine that an error of m of aim, of the saturation, is kept where
   it can be. *pieces gets how many pieces the rows hold together. Returns ANHYST_OK or
   ANHYST_BAD_PARAMETER: weights out of range, or curves so narrow beside the thresholds (below
   about 1/300 of the largest) that 1e-6 of the saturation cannot be kept. */
anhyst_status anhyst_cells_lay_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                                   double aim, size_t *pieces);

/* Fills the rows; storage holds what anhyst_cells_lay_f64 asked for, and must outlive the law.
   Error of m against the sums, with ANHYST_CELLS_AIM: 1e-12 of the saturation for curves down to
   1/30 of the largest threshold, growing with the sixth power of that ratio to 1e-6. A cell's curve
   is interpolated between other nodes on the way up than down: of that error up to a fifth adds up
   with every minor loop that is run through, till all cells move or the state is entered anew. */
void anhyst_cells_tabulate_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                               anhyst_cell_piece_f64 *storage);

/* A state from x and p_1..p_n (`cells` numbers), whatever they are: x is brought into reach (0 if
   it is not a number), and each place as near to the one before as their thresholds are. What is
   valid is not changed. */
void anhyst_cells_enter_f64(const anhyst_cells_f64 *cells, const double *numbers,
                            anhyst_cells_state_f64 *state);

/* x and p_1..p_n of a state. */
void anhyst_cells_numbers_f64(const anhyst_cells_f64 *cells, const anhyst_cells_state_f64 *state,
                              double *numbers);

/* Solves x + omega*m(x) = r, omega dimensionless and r in A/m, for the x that a monotone path from
   the state reaches first; the state is not touched.

   With 1 + omega*steepest > 0 the solution is unique. Otherwise m may jump: the row is walked piece
   by piece and the first solution taken. Where 1 + omega*reversible <= 0 every reversal would jump:
   ANHYST_REFUSED. Error: |x + omega*m - r| within 8 units in the last place of |x| + |r| +
   |omega|*saturation. Returns ANHYST_OK, ANHYST_REFUSED, ANHYST_OUT_OF_RANGE or
   ANHYST_NOT_CONVERGED; the candidate is valid only with ANHYST_OK. */
anhyst_status anhyst_cells_solve_f64(const anhyst_cells_f64 *cells,
                                     const anhyst_cells_state_f64 *state, double omega, double r,
                                     anhyst_cells_candidate_f64 *candidate);

/* Takes a solution over into the state from which it was found. */
void anhyst_cells_accept_f64(const anhyst_cells_f64 *cells, anhyst_cells_state_f64 *state,
                             const anhyst_cells_candidate_f64 *candidate);

#ifdef __cplusplus
}
#endif
#endif
