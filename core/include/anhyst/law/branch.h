/* SPDX-License-Identifier: Apache-2.0 */
/* The steady-state ascending branch of the Jiles-Atherton law as a table. */
#ifndef ANHYST_BRANCH_H
#define ANHYST_BRANCH_H

#include "anhyst/numeric/status.h"

/* Largest |x| of the tables, in units of a. */
#define ANHYST_X_MAX 89000.0
/* Range of kappa = k/a. */
#define ANHYST_KAPPA_MIN 1e-3
#define ANHYST_KAPPA_MAX 1e3

/* Layout of the table with quintic pieces: equal steps of x in the inner part, and equal steps of
   ln|x| in the outer parts. */
#define ANHYST_BRANCH_EDGE 30
#define ANHYST_BRANCH_PER_UNIT 8
#define ANHYST_BRANCH_INNER (2 * ANHYST_BRANCH_EDGE * ANHYST_BRANCH_PER_UNIT)
#define ANHYST_BRANCH_PER_LOG 32
#define ANHYST_BRANCH_OUTER (8 * ANHYST_BRANCH_PER_LOG)

#ifdef __cplusplus
extern "C" {
#endif

/* A function of x in quintic pieces: coefficients of powers of the position, 0 to 1. */
typedef struct {
  double inner[ANHYST_BRANCH_INNER][6]; /* -30 <= x <= 30 */
  double left[ANHYST_BRANCH_OUTER][6];  /* x < -30, over ln(-x/30) */
  double right[ANHYST_BRANCH_OUTER][6]; /* x > 30, over ln(x/30) */
} anhyst_pieces_f64;

/* The steady-state ascending branch A(x) of the law for M_s = a = 1: the bounded solution of
   kappa*A' = L(x) - A. About 48 kB; the caller owns the storage. */
typedef struct {
  double kappa;
  anhyst_pieces_f64 value;
} anhyst_branch_f64;

/* dA/dkappa of a branch, only for the sensitivities. */
typedef struct {
  anhyst_pieces_f64 value;
} anhyst_branch_slope_f64;

/* Tabulates A for kappa in [ANHYST_KAPPA_MIN, ANHYST_KAPPA_MAX] by the recursion A(x+h) =
   exp(-h/kappa)*A(x) + integral of exp(-s)*L(x+h-kappa*s) over 0 < s < h/kappa, with 8-point Gauss
   panels. The error of an interpolated value is 4e-11. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER
   without a change of the branch. */
anhyst_status anhyst_branch_build_f64(anhyst_branch_f64 *branch, double kappa);

/* Tabulates dA/dkappa for the same range of kappa; the error is 1e-9/kappa. */
anhyst_status anhyst_branch_slope_build_f64(anhyst_branch_slope_f64 *slope, double kappa);

/* Return A(x), and dA/dkappa at x. Above |x| = ANHYST_X_MAX, the value is constant. */
double anhyst_branch_at_f64(const anhyst_branch_f64 *branch, double x);
double anhyst_branch_slope_at_f64(const anhyst_branch_slope_f64 *slope, double x);

#ifdef __cplusplus
}
#endif
#endif
