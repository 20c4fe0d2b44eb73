/* SPDX-License-Identifier: Apache-2.0 */

/* Gains for one rate; T is the length of a tick. The caller selects the units of position, output
   and load. */
typedef struct {
  ANHYST_REAL proportional; /* K_p */
  ANHYST_REAL integral;     /* K_i*T */
  ANHYST_REAL derivative;   /* K_d/T */
  ANHYST_REAL second;       /* K_dd/T^2 */
  ANHYST_REAL load;         /* K_l */
  ANHYST_REAL back;         /* back-calculation gain: share of applied - u that is added to the
                               integral per tick, 0..1 */
  ANHYST_REAL smoothing;    /* share of a step that the first filter passes per tick, 0 < .. <= 1 */
  ANHYST_REAL smoothing_2;  /* of the second filter */
  ANHYST_REAL weight;       /* b, set-point weight, 0..1 */
  ANHYST_REAL low;          /* limits of the output */
  ANHYST_REAL high;
} anhyst_pidd2_gains_x;

/* State of the controller. */
typedef struct {
  ANHYST_REAL position; /* filtered */
  ANHYST_REAL velocity; /* first derivative, filtered twice, per tick */
  ANHYST_REAL integral; /* part of the output */
} anhyst_pidd2_state_x;

/* A solved output before its commit. */
typedef struct {
  anhyst_pidd2_state_x next; /* before back-calculation */
  ANHYST_REAL wanted;        /* before limits */
  ANHYST_REAL output;        /* within limits */
} anhyst_pidd2_candidate_x;

/* The functions are those of pidd2.h. Only the output is limited. Errors: rounding. */

/* Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if a gain is not finite, a share is out of its range,
   or the limits are in the wrong order. */
anhyst_status anhyst_pidd2_check_x(const anhyst_pidd2_gains_x *gains);

/* Initialises the state at rest at a position, with the integral that gives this output. */
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

/* Bumpless transfer from one set of gains to another with the same rate. */
void anhyst_pidd2_change_x(const anhyst_pidd2_gains_x *from, const anhyst_pidd2_gains_x *to,
                           anhyst_pidd2_state_x *state, ANHYST_REAL reference, ANHYST_REAL position,
                           ANHYST_REAL load);
