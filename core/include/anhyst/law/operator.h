/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law as an operator from effective field to magnetisation. */
#ifndef ANHYST_OPERATOR_H
#define ANHYST_OPERATOR_H

#include "anhyst/law/branch.h"
#include "anhyst/numeric/status.h"

/* Largest alpha*c*M_s/a of the law of 1986. At 3, its irreversible part becomes vertical. Above
   2.85, its sub-steps of kappa/8*(1 - eps/3) are not certain to be stable. */
#define ANHYST_EPS_MAX 2.85

/* Method for the irreversible part over one step. */
typedef enum {
  ANHYST_STEP_EXACT = 0,  /* effective-field law, exact for any step length */
  ANHYST_STEP_LINEAR = 1, /* effective-field law, anhysteretic curve linear over the step */
  ANHYST_STEP_JA1986 = 2  /* law of 1986, classical Runge-Kutta sub-steps */
} anhyst_step;

#ifdef __cplusplus
extern "C" {
#endif

/* Parameters of a law in its own units, M_s = a = 1. Constant along a path. */
typedef struct {
  anhyst_step step;
  double kappa; /* k/a, ANHYST_KAPPA_MIN..ANHYST_KAPPA_MAX */
  double c;     /* reversibility, 0..1 */
  double play;  /* half-width r_d/a of the play before the irreversible part, >= 0 */
  double eps;   /* law of 1986 only: alpha*c*M_s/a, at most ANHYST_EPS_MAX; otherwise 0 */
  const anhyst_branch_f64 *branch; /* exact step only; built for the same kappa */
} anhyst_operator_f64;

/* State in units that do not depend on the parameter set. Zero is the demagnetised state. */
typedef struct {
  double x; /* effective field / a */
  double y; /* irreversible magnetisation / M_s, |y| < 1 */
  double p; /* play: field of the irreversible part / a; |x - p| <= play */
} anhyst_state_f64;

/* State, magnetisation and slopes at one point of a path. */
typedef struct {
  anhyst_state_f64 state;
  double m;       /* magnetisation / M_s */
  double m_slope; /* dm/dx, 0..anhyst_operator_steepest */
  double y_slope; /* dy/dx */
  double p_slope; /* dp/dx: 1 if the play moves, otherwise 0 */
} anhyst_answer_f64;

/* A monotone path from a state: data that are prepared once for many end points. */
typedef struct {
  const anhyst_operator_f64 *law;
  anhyst_state_f64 from;
  double sign;      /* direction of travel, +1 or -1 */
  double pull;      /* L(p0), the limit of the irreversible part at the start */
  double departure; /* p at which the irreversible part starts to move */
  double lead;      /* exact step: y - sign*A(sign*departure) */
  int departure_known;
} anhyst_path_f64;

/* Returns ANHYST_OK if all parameters are in their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_operator_check_f64(const anhyst_operator_f64 *law);

/* Checks a state from outside: |x - p| <= play, |L(p) - y| <= kappa/3, with a tolerance of 1e-9.
   Only such states keep the slope within its bound. */
anhyst_status anhyst_state_check_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Returns an upper bound A of dm/dx: 1/3, and 1/(3 - eps) for the law of 1986 with eps > 0. */
double anhyst_operator_steepest_f64(const anhyst_operator_f64 *law);

/* Returns the magnetisation of a state. */
double anhyst_operator_m_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Starts a path at a valid state in direction sign (+1 or -1). Sets *start to the magnetisation
   there and the slopes just after departure. */
void anhyst_path_begin_f64(anhyst_path_f64 *path, const anhyst_operator_f64 *law,
                           const anhyst_state_f64 *from, double sign, anhyst_answer_f64 *start);

/* Sets *answer to the point at x, on the path's side of its start. Does not change law and state.
   Errors of m: 5e-11 for the exact step; 0.0133*d^2 for the linear step of length d; about 2e-6 for
   the law of 1986 (Runge-Kutta with sub-steps of kappa/8, for eps > 0 of kappa/8*(1 - eps/3), and
   at most (1+|x|)/16). */
void anhyst_path_at_f64(anhyst_path_f64 *path, double x, anhyst_answer_f64 *answer);

#ifdef __cplusplus
}
#endif
#endif
