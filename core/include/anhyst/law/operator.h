/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law as an operator from effective field to magnetisation. */
#ifndef ANHYST_OPERATOR_H
#define ANHYST_OPERATOR_H

#include "anhyst/law/branch.h"
#include "anhyst/numeric/status.h"

/* Largest alpha*c*M_s/a of the Jiles-Atherton law of 1986. At 3, the irreversible part becomes
   vertical. Above 2.85, sub-steps of kappa/8*(1 - eps/3) may be unstable. */
#define ANHYST_EPS_MAX 2.85

/* Method for the irreversible part in one step. */
typedef enum {
  ANHYST_STEP_EXACT = 0,  /* law in the effective field, exact for any step length */
  ANHYST_STEP_LINEAR = 1, /* law in the effective field, anhysteretic curve linear along the step */
  ANHYST_STEP_JA1986 = 2  /* law of 1986, sub-steps of the classical Runge-Kutta method */
} anhyst_step;

#ifdef __cplusplus
extern "C" {
#endif

/* Parameters of a law in its own units, M_s = a = 1. The parameters are constant along a path. */
typedef struct {
  anhyst_step step;
  double kappa; /* k/a, ANHYST_KAPPA_MIN..ANHYST_KAPPA_MAX */
  double c;     /* reversible fraction, 0..1 */
  double play;  /* threshold r_d/a of the play before the irreversible part, >= 0 */
  double eps;   /* alpha*c*M_s/a for the law of 1986, at most ANHYST_EPS_MAX; otherwise 0 */
  const anhyst_branch_f64 *branch; /* branch for the same kappa; only for ANHYST_STEP_EXACT */
} anhyst_operator_f64;

/* State in units that do not depend on the parameter set. Zero is the demagnetised state. */
typedef struct {
  double x; /* effective field / a */
  double y; /* irreversible magnetisation / M_s, |y| < 1 */
  double p; /* position of the play: field of the irreversible part / a; |x - p| <= play */
} anhyst_state_f64;

/* State, magnetisation and slopes at one point of a path. */
typedef struct {
  anhyst_state_f64 state;
  double m;       /* magnetisation / M_s */
  double m_slope; /* dm/dx, 0..anhyst_operator_steepest */
  double y_slope; /* dy/dx */
  double p_slope; /* dp/dx. 1: the play moves; otherwise 0 */
} anhyst_answer_f64;

/* A monotone path from a state, with data that are computed once for many end points. */
typedef struct {
  const anhyst_operator_f64 *law;
  anhyst_state_f64 from;
  double sign;               /* direction of travel, +1 or -1 */
  double irreversible_limit; /* L(p0), limit of the irreversible part at the start of the path */
  double departure;       /* position of the play at which the irreversible part starts to move */
  double branch_distance; /* exact step only: y - sign*A(sign*departure) */
  int is_departure_known;
} anhyst_path_f64;

/* Returns ANHYST_OK if all parameters are in their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_operator_check_f64(const anhyst_operator_f64 *law);

/* Checks a state that the caller provides: |x - p| <= play and |L(p) - y| <= kappa/3, with a
   tolerance of 1e-9. The bound of anhyst_operator_steepest_f64 is valid only for such states. */
anhyst_status anhyst_state_check_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Returns an upper bound A of dm/dx: 1/3, or 1/(3 - eps) for the law of 1986 with eps > 0. */
double anhyst_operator_steepest_f64(const anhyst_operator_f64 *law);

/* Returns the magnetisation of a state. */
double anhyst_operator_m_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Starts a path at a valid state in the direction `sign` (+1 or -1). Sets *start to the
   magnetisation at this state and the slopes just after the start. */
void anhyst_path_begin_f64(anhyst_path_f64 *path, const anhyst_operator_f64 *law,
                           const anhyst_state_f64 *from, double sign, anhyst_answer_f64 *start);

/* Sets *answer to the point of the path at x. x must not be before the start of the path. Does not
   change the law and the state. Errors of m: 5e-11 for the exact step; 0.0133*d^2 for the linear
   step of length d; about 2e-6 for the law of 1986 (Runge-Kutta with sub-steps of kappa/8, for eps
   > 0 of kappa/8*(1 - eps/3), and at most (1+|x|)/16). */
void anhyst_path_at_f64(anhyst_path_f64 *path, double x, anhyst_answer_f64 *answer);

#ifdef __cplusplus
}
#endif
#endif
