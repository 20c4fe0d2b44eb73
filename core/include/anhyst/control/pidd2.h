/* SPDX-License-Identifier: Apache-2.0 */
/* A position controller in fixed point: proportional, integral, first and second derivative
   (PIDD2).

     u = P*(b*r - y) + I - D*y' - DD*y" + L*load
     I' = K*(r - y) + B*(applied - u)

   u is the output (a force), r the reference, and y the measured position. y' and y" are its
   filtered derivatives, and b is the set-point weight. The integral I uses the output that was
   really applied, so that it does not wind up, no matter which component limits the output
   (back-calculation).

   In each tick, solve, limit and apply the output, then commit the applied output. solve does not
   change the state. Signals are q31: 1.0 is the full scale of the position (for y and r), of the
   load, or of the output. Internally, positions and the integral are q30 (-2..2), derivatives are
   q30 of the position's full scale per tick, and the output is summed in q28 (-8..8). No
   calculation overflows. Each term of u saturates, at no less than twice full scale if its mantissa
   is normalised. The integral saturates at twice full scale, the output at its limits.

   No function contains a loop. Only branches of saturation depend on the signals. */
#ifndef ANHYST_PIDD2_H
#define ANHYST_PIDD2_H

#include "anhyst/numeric/factor.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Gains for one tick rate and one set of full scales. U, Y and L are the full scales of output,
   position and load. T is the length of a tick. The members smoothing and smoothing_2 are minus the
   fraction of a step that a low-pass filter passes in one tick. */
typedef struct {
  anhyst_factor proportional; /* P: K_p*Y/U/4 */
  anhyst_factor integral;     /* K: K_i*T*Y/U */
  anhyst_factor derivative;   /* D: K_d/T*Y/U/4 */
  anhyst_factor second;       /* DD: K_dd/T^2*Y/U/4 */
  anhyst_factor load;         /* L: K_l*L/U/8 */
  anhyst_factor back;         /* 4*B, >= 0; B: fraction of applied - u that corrects I per tick */
  anhyst_factor smoothing;    /* filter factor of the first derivative; its shift is 0 or 1 */
  anhyst_factor smoothing_2;  /* filter factor of the second derivative; its shift is 0 or 1 */
  int16_t unweighted;         /* -(1 - b)*32768: 0 for b = 1, -32768 for b = 0 */
  int16_t reserved;           /* 0 */
  int32_t low;                /* lowest output, q31 */
  int32_t high;               /* highest output, q31, not below low */
} anhyst_pidd2_gains_q31;

/* State of the controller, 12 bytes, with the same meaning for all gains of one tick rate and one
   set of full scales. Invariant: -2^30 <= position < 2^30. The other members may have any value. */
typedef struct {
  int32_t position; /* filtered position, q30 */
  int32_t velocity; /* first derivative, filtered twice, q30 per tick */
  int32_t integral; /* integral I, q30 of the full scale of the output */
} anhyst_pidd2_state_q31;

/* Result of a solve before its commit. */
typedef struct {
  anhyst_pidd2_state_q31 next; /* state of the next tick, before back-calculation */
  int32_t unlimited_output;    /* u before limits, q28 */
  int32_t output;              /* u within limits, q31 */
} anhyst_pidd2_candidate_q31;

/* Returns ANHYST_OK if the gains are within their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_pidd2_check_q31(const anhyst_pidd2_gains_q31 *gains);

/* Initialises the state at standstill, with the integral that gives this output. The transfer from
   a manually set output is therefore bumpless. Saturates at twice full scale. */
void anhyst_pidd2_start_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                            int32_t reference, int32_t position, int32_t load, int32_t output);

/* Returns the output for this tick within the limits, q31, and the other results in *candidate.
   Without saturation, the error against exact arithmetic with the same factors and integral is at
   most 5 + 2*proportional + 3*derivative + 8*second in LSB of q28. Per tick, the integral deviates
   from the exact one by less than 1 + integral in LSB of q30. */
int32_t anhyst_pidd2_solve_q31(const anhyst_pidd2_gains_q31 *gains,
                               const anhyst_pidd2_state_q31 *state, int32_t reference,
                               int32_t position, int32_t load,
                               anhyst_pidd2_candidate_q31 *candidate);

/* Advances the state to the candidate, and corrects the integral by the unapplied output. */
void anhyst_pidd2_commit_q31(const anhyst_pidd2_gains_q31 *gains, anhyst_pidd2_state_q31 *state,
                             const anhyst_pidd2_candidate_q31 *candidate, int32_t applied);

/* Adapts the state to other gains. With the given signals, the output of a solve does not change by
   a single bit (bumpless transfer), unless the integral saturates. */
void anhyst_pidd2_change_q31(const anhyst_pidd2_gains_q31 *from, const anhyst_pidd2_gains_q31 *to,
                             anhyst_pidd2_state_q31 *state, int32_t reference, int32_t position,
                             int32_t load);

#ifdef __cplusplus
}
#endif
#endif
