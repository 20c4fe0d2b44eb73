/* SPDX-License-Identifier: Apache-2.0 */

/* A function of x in quintic pieces: coefficients of powers of the place in the piece, 0 to 1. */
typedef struct {
  ANHYST_REAL inner[ANHYST_BRANCH_INNER][6]; /* -30 <= x <= 30 */
  ANHYST_REAL left[ANHYST_BRANCH_OUTER][6];  /* x < -30, by ln(-x/30) */
  ANHYST_REAL right[ANHYST_BRANCH_OUTER][6]; /* x > 30, by ln(x/30) */
} ANHYST_NAME(anhyst_pieces);

/* The steady ascending branch A(x) of the law for M_s = a = 1: the bounded solution of
   kappa*A' = L(x) - A. About 48 kB (double); the caller owns the storage. */
typedef struct {
  ANHYST_REAL kappa;
  ANHYST_NAME(anhyst_pieces) value;
} ANHYST_NAME(anhyst_branch);

/* dA/dkappa of a branch, for the sensitivities only. */
typedef struct {
  ANHYST_NAME(anhyst_pieces) value;
} ANHYST_NAME(anhyst_branch_slope);

/* Tabulates A for kappa in [ANHYST_KAPPA_MIN, ANHYST_KAPPA_MAX] by the recursion
   A(x+h) = exp(-h/kappa)*A(x) + integral of exp(-s)*L(x+h-kappa*s) over 0 < s < h/kappa, with
   8-point Gauss panels. Error of the interpolated value: 4e-11 (double), 2e-6 (single).
   Returns ANHYST_OK or ANHYST_BAD_PARAMETER (branch unchanged). */
anhyst_status ANHYST_NAME(anhyst_branch_build)(ANHYST_NAME(anhyst_branch) *branch,
                                               ANHYST_REAL kappa);

/* Tabulates dA/dkappa, for the same kappa range; error 1e-9/kappa (double). */
anhyst_status ANHYST_NAME(anhyst_branch_slope_build)(ANHYST_NAME(anhyst_branch_slope) *slope,
                                                     ANHYST_REAL kappa);

/* A(x), and dA/dkappa at x. Beyond ANHYST_X_MAX the last piece is continued flat. */
ANHYST_REAL ANHYST_NAME(anhyst_branch_at)(const ANHYST_NAME(anhyst_branch) *branch, ANHYST_REAL x);
ANHYST_REAL ANHYST_NAME(anhyst_branch_slope_at)(const ANHYST_NAME(anhyst_branch_slope) *slope,
                                                ANHYST_REAL x);
