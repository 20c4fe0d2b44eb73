/* SPDX-License-Identifier: Apache-2.0 */
/* The steady-state ascending branch of the Jiles-Atherton law, as a table. */
#ifndef ANHYST_BRANCH_H
#define ANHYST_BRANCH_H

#include "anhyst/numeric/status.h"

/* Largest |x| of the tables, in units of a. */
#define ANHYST_X_MAX 89000.0
/* Range of kappa = k/a. */
#define ANHYST_KAPPA_MIN 1e-3
#define ANHYST_KAPPA_MAX 1e3

/* Layout of a table of quintic polynomials: equal intervals of x up to |x| = 30, then of ln|x|. */
#define ANHYST_BRANCH_EDGE 30
#define ANHYST_BRANCH_INTERVALS_PER_UNIT 8
#define ANHYST_BRANCH_INNER (2 * ANHYST_BRANCH_EDGE * ANHYST_BRANCH_INTERVALS_PER_UNIT)
#define ANHYST_BRANCH_INTERVALS_PER_LOG 32
#define ANHYST_BRANCH_OUTER (8 * ANHYST_BRANCH_INTERVALS_PER_LOG)

#ifdef __cplusplus
extern "C" {
#endif

/* A function of x as quintic polynomials. Each row has the polynomial coefficients of an interval.
   The variable is the position in the interval, 0 to 1. */
typedef struct {
  double inner[ANHYST_BRANCH_INNER][6]; /* intervals of x, -30 <= x <= 30 */
  double left[ANHYST_BRANCH_OUTER][6];  /* intervals of ln(-x/30), x < -30 */
  double right[ANHYST_BRANCH_OUTER][6]; /* intervals of ln(x/30), x > 30 */
} anhyst_pieces_f64;

/* The steady-state ascending branch A(x) of the law for M_s = a = 1. A(x) is the bounded solution
   of kappa*A' = L(x) - A. The caller provides the storage, about 48 kB. */
typedef struct {
  double kappa;
  anhyst_pieces_f64 value;
} anhyst_branch_f64;

/* The derivative dA/dkappa of a branch, for parameter derivatives only. */
typedef struct {
  anhyst_pieces_f64 value;
} anhyst_branch_slope_f64;

/* Tabulates A for kappa in [ANHYST_KAPPA_MIN, ANHYST_KAPPA_MAX]. Uses the recursion A(x+h) =
   exp(-h/kappa)*A(x) + integral of exp(-s)*L(x+h-kappa*s) over 0 < s < h/kappa, with 8-point Gauss
   quadrature. The error of an interpolated value is 4e-11. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if kappa is out of range; then the branch is unchanged. */
anhyst_status anhyst_branch_build_f64(anhyst_branch_f64 *branch, double kappa);

/* Tabulates dA/dkappa for the same range of kappa. The error is 1e-9/kappa. */
anhyst_status anhyst_branch_slope_build_f64(anhyst_branch_slope_f64 *slope, double kappa);

/* Return A(x), and dA/dkappa at x. The result is constant above |x| = ANHYST_X_MAX. */
double anhyst_branch_at_f64(const anhyst_branch_f64 *branch, double x);
double anhyst_branch_slope_at_f64(const anhyst_branch_slope_f64 *slope, double x);

#ifdef __cplusplus
}
#endif
#endif
