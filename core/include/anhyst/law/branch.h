/* SPDX-License-Identifier: Apache-2.0 */
/* The steady ascending branch of the law, tabulated. */
#ifndef ANHYST_BRANCH_H
#define ANHYST_BRANCH_H

#include "anhyst/numeric/status.h"

/* Largest |x| (in units of a) the tables cover. */
#define ANHYST_X_MAX 89000.0
/* Range of kappa = k/a. */
#define ANHYST_KAPPA_MIN 1e-3
#define ANHYST_KAPPA_MAX 1e3

/* Layout of the table: even spacing inside, even spacing of ln|x| outside, quintic pieces. */
#define ANHYST_BRANCH_EDGE 30
#define ANHYST_BRANCH_PER_UNIT 8
#define ANHYST_BRANCH_INNER (2 * ANHYST_BRANCH_EDGE * ANHYST_BRANCH_PER_UNIT)
#define ANHYST_BRANCH_PER_LOG 32
#define ANHYST_BRANCH_OUTER (8 * ANHYST_BRANCH_PER_LOG)

#ifdef __cplusplus
extern "C" {
#endif

/* A function of x in quintic pieces: coefficients of powers of the place in the piece, 0 to 1. */
typedef struct {
  double inner[ANHYST_BRANCH_INNER][6]; /* -30 <= x <= 30 */
  double left[ANHYST_BRANCH_OUTER][6];  /* x < -30, by ln(-x/30) */
  double right[ANHYST_BRANCH_OUTER][6]; /* x > 30, by ln(x/30) */
} anhyst_pieces_f64;

/* The steady ascending branch A(x) of the law for M_s = a = 1: the bounded solution of
   kappa*A' = L(x) - A. About 48 kB; the caller owns the storage. */
typedef struct {
  double kappa;
  anhyst_pieces_f64 value;
} anhyst_branch_f64;

/* dA/dkappa of a branch, for the sensitivities only. */
typedef struct {
  anhyst_pieces_f64 value;
} anhyst_branch_slope_f64;

/* Tabulates A for kappa in [ANHYST_KAPPA_MIN, ANHYST_KAPPA_MAX] by the recursion
   A(x+h) = exp(-h/kappa)*A(x) + integral of exp(-s)*L(x+h-kappa*s) over 0 < s < h/kappa, with
   8-point Gauss panels. Error of the interpolated value: 4e-11.
   Returns ANHYST_OK or ANHYST_BAD_PARAMETER (branch unchanged). */
anhyst_status anhyst_branch_build_f64(anhyst_branch_f64 *branch, double kappa);

/* Tabulates dA/dkappa, for the same kappa range; error 1e-9/kappa. */
anhyst_status anhyst_branch_slope_build_f64(anhyst_branch_slope_f64 *slope, double kappa);

/* A(x), and dA/dkappa at x. Beyond ANHYST_X_MAX the last piece is continued flat. */
double anhyst_branch_at_f64(const anhyst_branch_f64 *branch, double x);
double anhyst_branch_slope_at_f64(const anhyst_branch_slope_f64 *slope, double x);

#ifdef __cplusplus
}
#endif
#endif
