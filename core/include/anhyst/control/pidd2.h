/* SPDX-License-Identifier: Apache-2.0 */
/* A position controller in fixed point: proportional, integral, first and second derivative.

     u = P*(b*r - y) + I - D*y' - DD*y" + L*load
     I' = K*(r - y) + B*(applied - u)

   r is the reference, y the measured position, y' and y" its filtered derivatives, b the weight of
   the set point. The integral learns from the output that was really applied, so it does not wind
   up whoever limits that output (back-calculation).

   At every tick: solve, limit and apply, then commit what was applied. solve does not touch the
   state. Signals are q31: 1.0 is the full scale of the position (reference, position), of the
   load, or of the output. Inside, positions and the integral are q30 (-2..2), derivatives q30 of
   the position's full scale a tick, and the output is summed up in q28 (-8..8). Nothing wraps:
   each term of u saturates, no earlier than at twice full scale if its mantissa is normalised, the
   integral at twice full scale, the output at its limits.

   No loops; the same instructions whatever the signals are, but for branches of saturation. */
#ifndef ANHYST_PIDD2_H
#define ANHYST_PIDD2_H

#include "anhyst/numeric/factor.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Gains for one rate and one set of full scales. U, Y and L are the full scales of output,
   position and load, T is the length of a tick. The smoothings are minus the share of a step that
   a filter passes in one tick, see anhyst_factor_is_share. */
typedef struct {
  anhyst_factor proportional; /* K_p*Y/U/4 */
  anhyst_factor integral;     /* K_i*T*Y/U */
  anhyst_factor derivative;   /* K_d/T*Y/U/4 */
  anhyst_factor second;       /* K_dd/T^2*Y/U/4 */
  anhyst_factor load;         /* K_l*L/U/8 */
  anhyst_factor back;         /* 4*share of applied - u that the integral takes in one tick, >= 0 */
  anhyst_factor smoothing;    /* of the first derivative, shift 0 or 1 */
  anhyst_factor smoothing_2;  /* of the second, likewise */
  int16_t unweighted;         /* -(1 - b)*32768: 0 for b = 1, -32768 for b = 0 */
  int16_t reserved;           /* 0 */
  int32_t low;                /* q31, limits of the output */
  int32_t high;               /* q31, not below low */
} anhyst_pidd2_gains_q31;

/* What the controller remembers; 12 bytes. It means the same under all gains of one rate and one
   set of full scales. Invariant: -2^30 <= position < 2^30; the others are any numbers. */
typedef struct {
  int32_t position; /* filtered, q30 */
  int32_t velocity; /* filtered first derivative once more filtered, q30 a tick */
  int32_t integral; /* q30 of the output */
} anhyst_pidd2_state_q31;

/* A solved output that has not been committed. */
typedef struct {
  anhyst_pidd2_state_q31 next; /* before back-calculation */
  int32_t wanted;              /* u before limits, q28 */
  int32_t output;              /* u within limits, q31 */
} anhyst_pidd2_candidate_q31;

/* Whether gains are within their ranges: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains);

/* At rest at that position, with the integral that makes the output be the given one: taking over
   from a hand-set output is without a jump. Saturates at twice full scale. */
void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output);

/* The output for this tick, within the limits, q31; the rest of the answer is in *candidate.
   Error against exact arithmetic with the same factors, nothing saturated and the same integral,
   in units of q28: 5 plus twice P's factor, 3 times D's, 8 times DD's. The integral departs from
   the exact one by less than 1 + K's factor in units of q30 each tick. */
int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate);

/* Advances the state: the candidate's, its integral led back by what was not applied. */
void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied);

/* Goes over from one set of gains to another without a jump: for these signals the output of a
   solve is the same to the last bit, unless the integral saturates. */
void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load);

#ifdef __cplusplus
}
#endif
#endif
