/* SPDX-License-Identifier: Apache-2.0 */

/* Parameters of a law in units of its own: M_s = a = 1. Constant while a path is followed. */
typedef struct {
  anhyst_step step;
  ANHYST_REAL kappa; /* k/a, ANHYST_KAPPA_MIN..ANHYST_KAPPA_MAX */
  ANHYST_REAL c;     /* reversibility, 0..1 */
  ANHYST_REAL play;  /* half-width r_d/a of the play in front of the irreversible part, >= 0 */
  ANHYST_REAL eps;   /* law of 1986 only: alpha*c*M_s/a, at most ANHYST_EPS_MAX; else 0 */
  const ANHYST_NAME(anhyst_branch) *branch; /* exact step only; built for the same kappa */
} ANHYST_NAME(anhyst_operator);

/* State, in units that do not depend on the parameter set. Zero is the demagnetised state. */
typedef struct {
  ANHYST_REAL x; /* effective field / a */
  ANHYST_REAL y; /* irreversible magnetisation / M_s, |y| < 1 */
  ANHYST_REAL p; /* play: field that the irreversible part feels / a; |x - p| <= play */
} ANHYST_NAME(anhyst_state);

/* What the law answers at one place. */
typedef struct {
  ANHYST_NAME(anhyst_state) state;
  ANHYST_REAL m;       /* magnetisation / M_s */
  ANHYST_REAL m_slope; /* dm/dx, 0..anhyst_operator_steepest */
  ANHYST_REAL y_slope; /* dy/dx */
  ANHYST_REAL p_slope; /* dp/dx: 1 where the play is carried along, else 0 */
} ANHYST_NAME(anhyst_answer);

/* A monotone path that starts at a state: what can be prepared once and used for many ends. */
typedef struct {
  const ANHYST_NAME(anhyst_operator) *law;
  ANHYST_NAME(anhyst_state) from;
  ANHYST_REAL sign;      /* direction of travel, +1 or -1 */
  ANHYST_REAL pull;      /* L(p0), what the irreversible part strives for at the start */
  ANHYST_REAL departure; /* p at which the irreversible part starts to move */
  ANHYST_REAL lead;      /* exact step: y - sign*A(sign*departure) */
  int departure_known;
} ANHYST_NAME(anhyst_path);

/* Checks ranges: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status ANHYST_NAME(anhyst_operator_check)(const ANHYST_NAME(anhyst_operator) *law);

/* Checks a state given from outside: |x - p| <= play, |L(p) - y| <= kappa/3, with a tolerance of
   1e-9 (double) or 1e-5 (single). Only such states keep the slope within its bound. */
anhyst_status ANHYST_NAME(anhyst_state_check)(const ANHYST_NAME(anhyst_operator) *law,
                                              const ANHYST_NAME(anhyst_state) *state);

/* Upper bound A of dm/dx: 1/3, and for the law of 1986 with eps > 0, 1/(3 - eps). */
ANHYST_REAL ANHYST_NAME(anhyst_operator_steepest)(const ANHYST_NAME(anhyst_operator) *law);

/* Magnetisation in a state, without moving. */
ANHYST_REAL ANHYST_NAME(anhyst_operator_m)(const ANHYST_NAME(anhyst_operator) *law,
                                           const ANHYST_NAME(anhyst_state) *state);

/* Starts a path from a valid state in direction sign (+1 or -1); *start gets the magnetisation
   there and the slopes just after departure. */
void ANHYST_NAME(anhyst_path_begin)(ANHYST_NAME(anhyst_path) *path,
                                    const ANHYST_NAME(anhyst_operator) *law,
                                    const ANHYST_NAME(anhyst_state) *from, ANHYST_REAL sign,
                                    ANHYST_NAME(anhyst_answer) *start);

/* The answer at x, on the path's side of its start. Neither law nor state is changed.
   Error of m: 5e-11 exact step (double); linear step 0.0133*d^2 for a step of length d; law of
   1986 about 2e-6 (Runge-Kutta, sub-steps of kappa/8, of kappa/8*(1 - eps/3) for eps > 0, and at
   most (1+|x|)/16). */
void ANHYST_NAME(anhyst_path_at)(ANHYST_NAME(anhyst_path) *path, ANHYST_REAL x,
                                 ANHYST_NAME(anhyst_answer) *answer);
