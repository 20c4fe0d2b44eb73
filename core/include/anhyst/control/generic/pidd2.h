/* SPDX-License-Identifier: Apache-2.0 */

/* Gains for ticks of length T. The caller selects the units of position, output and load. */
typedef struct {
  ANHYST_REAL proportional; /* K_p */
  ANHYST_REAL integral;     /* K_i*T */
  ANHYST_REAL derivative;   /* K_d/T */
  ANHYST_REAL second;       /* K_dd/T^2 */
  ANHYST_REAL load;         /* K_l */
  ANHYST_REAL back;         /* fraction of applied - u that corrects the integral per tick, 0..1 */
  ANHYST_REAL smoothing;    /* first filter: fraction of a step that passes per tick, > 0, <= 1 */
  ANHYST_REAL smoothing_2;  /* second filter: fraction of a step that passes per tick, > 0, <= 1 */
  ANHYST_REAL weight;       /* set-point weight b, 0..1 */
  ANHYST_REAL low;          /* lowest and highest output */
  ANHYST_REAL high;
} anhyst_pidd2_gains_x;

/* State of the controller. */
typedef struct {
  ANHYST_REAL position; /* filtered position */
  ANHYST_REAL velocity; /* first derivative, filtered twice, per tick */
  ANHYST_REAL integral; /* integral I, in the unit of the output */
} anhyst_pidd2_state_x;

/* Result of a solve before its commit. */
typedef struct {
  anhyst_pidd2_state_x next;    /* state of the next tick, before back-calculation */
  ANHYST_REAL unlimited_output; /* output u before limits */
  ANHYST_REAL output;           /* output u within limits */
} anhyst_pidd2_candidate_x;

/* The functions work as those of pidd2.h, but only the output is limited. Errors: rounding. */

/* Returns ANHYST_OK. Returns ANHYST_BAD_PARAMETER if a gain is not finite, a fraction is out of its
   range, or low is above high. */
anhyst_status anhyst_pidd2_check_x(const anhyst_pidd2_gains_x *gains);

/* Initialises the state at standstill, with the integral that gives this output. */
void anhyst_pidd2_start_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                          ANHYST_REAL reference, ANHYST_REAL position, ANHYST_REAL load,
                          ANHYST_REAL output);

/* Returns the output for this tick within the limits. Does not change the state. */
ANHYST_REAL anhyst_pidd2_solve_x(const anhyst_pidd2_gains_x *gains,
                                 const anhyst_pidd2_state_x *state, ANHYST_REAL reference,
                                 ANHYST_REAL position, ANHYST_REAL load,
                                 anhyst_pidd2_candidate_x *candidate);

/* Advances the state with the applied output. */
void anhyst_pidd2_commit_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                           const anhyst_pidd2_candidate_x *candidate, ANHYST_REAL applied);

/* Adapts the state to other gains for the same tick rate (bumpless transfer). */
void anhyst_pidd2_change_x(const anhyst_pidd2_gains_x *from, const anhyst_pidd2_gains_x *to,
                           anhyst_pidd2_state_x *state, ANHYST_REAL reference, ANHYST_REAL position,
                           ANHYST_REAL load);
