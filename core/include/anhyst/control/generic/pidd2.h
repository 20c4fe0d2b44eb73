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
} ANHYST_NAME(anhyst_pidd2_gains);

/* What the controller remembers. */
typedef struct {
  ANHYST_REAL position; /* filtered */
  ANHYST_REAL velocity; /* filtered first derivative once more filtered, a tick */
  ANHYST_REAL integral; /* of the output */
} ANHYST_NAME(anhyst_pidd2_state);

/* A solved output that has not been committed. */
typedef struct {
  ANHYST_NAME(anhyst_pidd2_state) next; /* before back-calculation */
  ANHYST_REAL wanted;                   /* before limits */
  ANHYST_REAL output;                   /* within limits */
} ANHYST_NAME(anhyst_pidd2_candidate);

/* The functions are those of pidd2.h; nothing but the output is limited. Error: rounding. */

/* ANHYST_OK or ANHYST_BAD_PARAMETER: a gain that is not finite, a share out of its range, limits
   in the wrong order. */
anhyst_status ANHYST_NAME(anhyst_pidd2_check)(const ANHYST_NAME(anhyst_pidd2_gains) *gains);

/* At rest at that position, with the integral that makes the output be the given one. */
void ANHYST_NAME(anhyst_pidd2_start)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                     ANHYST_NAME(anhyst_pidd2_state) *state, ANHYST_REAL reference,
                                     ANHYST_REAL position, ANHYST_REAL load, ANHYST_REAL output);

/* The output for this tick, within the limits; the state is not touched. */
ANHYST_REAL ANHYST_NAME(anhyst_pidd2_solve)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                            const ANHYST_NAME(anhyst_pidd2_state) *state,
                                            ANHYST_REAL reference, ANHYST_REAL position,
                                            ANHYST_REAL load,
                                            ANHYST_NAME(anhyst_pidd2_candidate) *candidate);

/* Advances the state with the output that was applied. */
void ANHYST_NAME(anhyst_pidd2_commit)(const ANHYST_NAME(anhyst_pidd2_gains) *gains,
                                      ANHYST_NAME(anhyst_pidd2_state) *state,
                                      const ANHYST_NAME(anhyst_pidd2_candidate) *candidate,
                                      ANHYST_REAL applied);

/* Goes over from one set of gains to another of the same rate without a jump of the output. */
void ANHYST_NAME(anhyst_pidd2_change)(const ANHYST_NAME(anhyst_pidd2_gains) *from,
                                      const ANHYST_NAME(anhyst_pidd2_gains) *to,
                                      ANHYST_NAME(anhyst_pidd2_state) *state, ANHYST_REAL reference,
                                      ANHYST_REAL position, ANHYST_REAL load);
