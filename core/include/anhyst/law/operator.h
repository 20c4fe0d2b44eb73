/* SPDX-License-Identifier: Apache-2.0 */
/* The hysteresis law as an operator from effective field to magnetisation. */
#ifndef ANHYST_OPERATOR_H
#define ANHYST_OPERATOR_H

#include "anhyst/law/branch.h"
#include "anhyst/numeric/status.h"

/* Largest alpha*c*M_s/a of the law of 1986. At 3 its irreversible part turns vertical; beyond 2.85
   its sub-steps, of kappa/8*(1 - eps/3), are no longer sure to be stable. */
#define ANHYST_EPS_MAX 2.85

/* How the irreversible part is carried over one step. */
typedef enum {
  ANHYST_STEP_EXACT = 0,  /* effective-field law, exact at any step length */
  ANHYST_STEP_LINEAR = 1, /* effective-field law, anhysteretic taken linear over the step */
  ANHYST_STEP_JA1986 = 2  /* law of 1986, classical Runge-Kutta sub-steps */
} anhyst_step;

#ifdef __cplusplus
extern "C" {
#endif

/* Parameters of a law in units of its own: M_s = a = 1. Constant while a path is followed. */
typedef struct {
  anhyst_step step;
  double kappa; /* k/a, ANHYST_KAPPA_MIN..ANHYST_KAPPA_MAX */
  double c;     /* reversibility, 0..1 */
  double play;  /* half-width r_d/a of the play in front of the irreversible part, >= 0 */
  double eps;   /* law of 1986 only: alpha*c*M_s/a, at most ANHYST_EPS_MAX; else 0 */
  const anhyst_branch_f64 *branch; /* exact step only; built for the same kappa */
} anhyst_operator_f64;

/* State, in units that do not depend on the parameter set. Zero is the demagnetised state. */
typedef struct {
  double x; /* effective field / a */
  double y; /* irreversible magnetisation / M_s, |y| < 1 */
  double p; /* play: field that the irreversible part feels / a; |x - p| <= play */
} anhyst_state_f64;

/* What the law answers at one place. */
typedef struct {
  anhyst_state_f64 state;
  double m;       /* magnetisation / M_s */
  double m_slope; /* dm/dx, 0..anhyst_operator_steepest */
  double y_slope; /* dy/dx */
  double p_slope; /* dp/dx: 1 where the play is carried along, else 0 */
} anhyst_answer_f64;

/* A monotone path that starts at a state: what can be prepared once and used for many ends. */
typedef struct {
  const anhyst_operator_f64 *law;
  anhyst_state_f64 from;
  double sign;      /* direction of travel, +1 or -1 */
  double pull;      /* L(p0), what the irreversible part strives for at the start */
  double departure; /* p at which the irreversible part starts to move */
  double lead;      /* exact step: y - sign*A(sign*departure) */
  int departure_known;
} anhyst_path_f64;

/* Checks ranges: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_operator_check_f64(const anhyst_operator_f64 *law);

/* Checks a state given from outside: |x - p| <= play, |L(p) - y| <= kappa/3, with a tolerance of
   1e-9. Only such states keep the slope within its bound. */
anhyst_status anhyst_state_check_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Upper bound A of dm/dx: 1/3, and for the law of 1986 with eps > 0, 1/(3 - eps). */
double anhyst_operator_steepest_f64(const anhyst_operator_f64 *law);

/* Magnetisation in a state, without moving. */
double anhyst_operator_m_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state);

/* Starts a path from a valid state in direction sign (+1 or -1); *start gets the magnetisation
   there and the slopes just after departure. */
void anhyst_path_begin_f64(anhyst_path_f64 *path, const anhyst_operator_f64 *law,
                           const anhyst_state_f64 *from, double sign, anhyst_answer_f64 *start);

/* The answer at x, on the path's side of its start. Neither law nor state is changed.
   Error of m: 5e-11 exact step; linear step 0.0133*d^2 for a step of length d; law of
   1986 about 2e-6 (Runge-Kutta, sub-steps of kappa/8, of kappa/8*(1 - eps/3) for eps > 0, and at
   most (1+|x|)/16). */
void anhyst_path_at_f64(anhyst_path_f64 *path, double x, anhyst_answer_f64 *answer);

#ifdef __cplusplus
}
#endif
#endif
