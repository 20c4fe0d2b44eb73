/* SPDX-License-Identifier: Apache-2.0 */
/* A filter of second order in fixed point: a notch at a resonance, a low-pass, a lead.

   In floating point (biquad_real.h) it is given by the coefficients of z. Here it is given as what
   it is made of, two integrators in a loop:

     fast    = integral_1 - loss*integral_1 + pass*(in - integral_2)
     slow    = integral_2 + pass*integral_1 + low*(in - integral_2)
     out     = through*in + of_fast*fast + of_slow*slow

   which by the trapezoidal rule is any filter with poles within the unit circle. What it does at
   rest then hangs on no difference of rounded coefficients: a notch passes what stands still as it
   is, whatever its frequency.

   Signals are q31, inside all is q30 (-2..2) and saturates. Error of one step against exact
   arithmetic with the same factors, nothing saturated, in units of q30: 2 of fast and of slow, and
   of the output 4 plus twice of_fast's and of_slow's factors. A notch passes what stands still to
   less than 8*(4 + k/g) units in the last place. No loops. */
#ifndef ANHYST_BIQUAD_H
#define ANHYST_BIQUAD_H

#include "anhyst/numeric/factor.h"
#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* g is tan(pi*f*T) of the filter's own frequency f, k what is left of a second at it (twice its
   damping ratio), and d = 1/(1 + g*(g + k)). */
typedef struct {
  anhyst_factor loss;    /* g*(g + k)*d */
  anhyst_factor pass;    /* g*d */
  anhyst_factor low;     /* g*g*d */
  anhyst_factor through; /* of the input in the output */
  anhyst_factor of_fast;
  anhyst_factor of_slow;
} anhyst_biquad_q31;

/* Two integrals, q30; zero is rest. Any numbers are a state. */
typedef struct {
  int32_t integral[2];
} anhyst_biquad_state_q31;

/* Whether every factor is valid: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_biquad_check_q31(const anhyst_biquad_q31 *filter);

/* The output for this tick; the state goes on to the next. */
int32_t anhyst_biquad_step_q31(const anhyst_biquad_q31 *filter, anhyst_biquad_state_q31 *state,
                               int32_t in);

#ifdef __cplusplus
}
#endif
#endif
