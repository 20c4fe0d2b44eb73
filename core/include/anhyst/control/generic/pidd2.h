/* SPDX-License-Identifier: Apache-2.0 */

/* Gains for one rate; T is the length of a tick. Positions, outputs and loads in units of the
   caller's choice. */
typedef struct {
  ANHYST_REAL proportional; /* K_p */
  ANHYST_REAL integral;     /* K_i*T */
  ANHYST_REAL derivative;   /* K_d/T */
  ANHYST_REAL second;       /* K_dd/T^2 */
  ANHYST_REAL load;         /* K_l */
  ANHYST_REAL back;         /* share of applied - u that the integral takes in a tick, 0..1 */
  ANHYST_REAL smoothing;   /* share of a step that the first filter passes in a tick, 0 < .. <= 1 */
  ANHYST_REAL smoothing_2; /* of the second */
  ANHYST_REAL weight;      /* b, of the set point, 0..1 */
  ANHYST_REAL low;         /* limits of the output */
  ANHYST_REAL high;
} anhyst_pidd2_gains_x;

/* What the controller remembers. */
typedef struct {
  ANHYST_REAL position; /* filtered */
  ANHYST_REAL velocity; /* filtered first derivative once more filtered, a tick */
  ANHYST_REAL integral; /* of the output */
} anhyst_pidd2_state_x;

/* A solved output that has not been committed. */
typedef struct {
  anhyst_pidd2_state_x next; /* before back-calculation */
  ANHYST_REAL wanted;        /* before limits */
  ANHYST_REAL output;        /* within limits */
} anhyst_pidd2_candidate_x;

/* The functions are those of pidd2.h; nothing but the output is limited. Error: rounding. */

/* ANHYST_OK or ANHYST_BAD_PARAMETER: a gain that is not finite, a share out of its range, limits
   in the wrong order. */
anhyst_status anhyst_pidd2_check_x(const anhyst_pidd2_gains_x *gains);

/* At rest at that position, with the integral that makes the output be the given one. */
void anhyst_pidd2_start_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                          ANHYST_REAL reference, ANHYST_REAL position, ANHYST_REAL load,
                          ANHYST_REAL output);

/* The output for this tick, within the limits; the state is not touched. */
ANHYST_REAL anhyst_pidd2_solve_x(const anhyst_pidd2_gains_x *gains,
                                 const anhyst_pidd2_state_x *state, ANHYST_REAL reference,
                                 ANHYST_REAL position, ANHYST_REAL load,
                                 anhyst_pidd2_candidate_x *candidate);

/* Advances the state with the output that was applied. */
void anhyst_pidd2_commit_x(const anhyst_pidd2_gains_x *gains, anhyst_pidd2_state_x *state,
                           const anhyst_pidd2_candidate_x *candidate, ANHYST_REAL applied);

/* Goes over from one set of gains to another of the same rate without a jump of the output. */
void anhyst_pidd2_change_x(const anhyst_pidd2_gains_x *from, const anhyst_pidd2_gains_x *to,
                           anhyst_pidd2_state_x *state, ANHYST_REAL reference, ANHYST_REAL position,
                           ANHYST_REAL load);
