/* SPDX-License-Identifier: Apache-2.0 */
/* A position controller in fixed point: proportional, integral, first and second derivative.

     u = P*(b*r - y) + I - D*y' - DD*y" + L*load
     I' = K*(r - y) + B*(applied - u)

   r is the reference, y the measured position, y' and y" its filtered derivatives, and b the
   set-point weight. The integral uses the output that was really applied, so that it does not wind
   up, no matter which component limits the output (back-calculation).

   In each tick, solve, limit and apply, then commit the applied output. solve does not change the
   state. Signals are q31: 1.0 is the full scale of the position (reference, position), of the load,
   or of the output. Internally, positions and the integral are q30 (-2..2), derivatives are q30 of
   the position's full scale per tick, and the output is summed in q28 (-8..8). Nothing wraps. Each
   term of u saturates, at no less than twice full scale if its mantissa is normalised, the integral
   at twice full scale, the output at its limits.

   No loops. The instructions do not depend on the signals, except for branches of saturation. */
#ifndef ANHYST_PIDD2_H
#define ANHYST_PIDD2_H

#include "anhyst/numeric/factor.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Gains for one rate and one set of full scales. U, Y and L are the full scales of output, position
   and load; T is the length of a tick. The smoothings are minus the share of a step that a filter
   passes in one tick, see anhyst_factor_is_share. */
typedef struct {
  anhyst_factor proportional; /* K_p*Y/U/4 */
  anhyst_factor integral;     /* K_i*T*Y/U */
  anhyst_factor derivative;   /* K_d/T*Y/U/4 */
  anhyst_factor second;       /* K_dd/T^2*Y/U/4 */
  anhyst_factor load;         /* K_l*L/U/8 */
  anhyst_factor back;         /* 4*(back-calculation gain): share of applied - u that is added to
                                 the integral per tick, >= 0 */
  anhyst_factor smoothing;    /* of the first derivative; shift 0 or 1 */
  anhyst_factor smoothing_2;  /* of the second derivative; shift 0 or 1 */
  int16_t unweighted;         /* -(1 - b)*32768: 0 for b = 1, -32768 for b = 0 */
  int16_t reserved;           /* 0 */
  int32_t low;                /* q31, limits of the output */
  int32_t high;               /* q31, not below low */
} anhyst_pidd2_gains_q31;

/* State of the controller; 12 bytes. It has the same meaning for all gains of one rate and one set
   of full scales. Invariant: -2^30 <= position < 2^30; the other members are any numbers. */
typedef struct {
  int32_t position; /* filtered, q30 */
  int32_t velocity; /* first derivative, filtered twice, q30 per tick */
  int32_t integral; /* q30 of the output */
} anhyst_pidd2_state_q31;

/* A solved output before its commit. */
typedef struct {
  anhyst_pidd2_state_q31 next; /* before back-calculation */
  int32_t wanted;              /* u before limits, q28 */
  int32_t output;              /* u within limits, q31 */
} anhyst_pidd2_candidate_q31;

/* Returns ANHYST_OK if the gains are within their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains);

/* Initialises the state at rest at a position, with the integral that gives this output. The
   transfer from a manually set output is therefore bumpless. Saturates at twice full scale. */
void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output);

/* Returns the output for this tick within the limits, q31, and the remaining results in *candidate.
   Errors against exact arithmetic with the same factors and the same integral, without saturation,
   in LSB of q28: 5 plus twice P's factor, 3 times D's, 8 times DD's. Per tick, the integral
   deviates from the exact one by less than 1 + K's factor in LSB of q30. */
int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate);

/* Advances the state to that of the candidate. The part of the output that was not applied corrects
   its integral. */
void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied);

/* Bumpless transfer from one set of gains to another. For these signals, the output of a solve does
   not change by a single bit, unless the integral saturates. */
void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load);

#ifdef __cplusplus
}
#endif
#endif
