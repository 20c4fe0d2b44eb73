/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller that measures the voltage of a coil instead of a flux density, in fixed point.
   The voltage is that of a sense coil around the iron (resistance 0), or of the winding itself. In
   each tick, `solve` receives the mean voltage of the last tick in place of the flux density. The
   flux of an inner force controller with the method `flux` or `fused` is then a flux linkage:

     law      = expected + inductance*correction        flux that the inner controller expects
     e        = e + gain*u - resistance*i - offset - (law - law of the last tick)
     flux     = law + e                                 the measured flux of the inner controller
     e        = e - pull*e
     offset   = offset + pull^2/4*e                     limited to -offset..offset
     resistance = resistance + learning*pull^2/4*e*i    limited to +-spread around the given value
     pull     = pull - pull^2/4                         from 1/16 down to the given pull

   The law gives the flux at standstill, the voltage gives every faster change. At an unknown offset
   the estimate deviates for some 1/pull ticks, then not at all. The resistance changes only if a
   current flows. While a limit of the demand or the current is active, the law does not describe
   the iron. Then only the voltage is integrated. The estimate starts at the law, also after a
   missing voltage, which is ANHYST_NO_FLUX here. `i` is the committed current, delayed to the
   middle of the last tick.

   Formats: signals are q31 codes of their full scales. The sums of the estimator have 60 fractional
   bits. No sum overflows, and each sum saturates (proved). The error of one step against exact
   arithmetic with the same numbers is at most 2^-30 of the flux: e is rounded to q31 before it is
   multiplied, and `pull^2/4` to 41 bits. */
#ifndef ANHYST_COIL_FLUX_H
#define ANHYST_COIL_FLUX_H

#include "anhyst/compensator/force_controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_COIL_LEARNING 1U /* the resistance learns 2^(6 - 1) times as fast as the offset */
#define ANHYST_COIL_LARGE ((int32_t)536870912) /* 1/4: currents that teach the resistance, q31 */
#define ANHYST_COIL_MOST ((int32_t)268435456)  /* 2^28: the largest gain or resistance, 1/2 */

/* U, I and B are the full scales of voltage, current and flux, and T is the length of a tick. */
typedef struct {
  int32_t gain;       /* T*U/B, q29, 0 < .. <= 1/2 */
  int32_t resistance; /* R*T*I/B, q29, 0..1/2 */
  int32_t spread;     /* largest change of `resistance`, q29, 0..resistance */
  int32_t offset;     /* largest estimated offset, in units of B per tick, q40, >= 0 */
  int32_t inductance; /* flux per current, in units of B/I, q29, >= 0 */
  int32_t lag;   /* fraction of a current step that is in the mean of the next tick, q31, > 0 */
  int32_t range; /* voltage at and above which a reading is limited, q31, > 0 */
  int32_t reach; /* largest deviation from the law, q31, > 0 */
  int32_t pull;  /* final pull per tick, q35, > 0 */
} anhyst_coil_flux_settings_q31;

typedef int64_t anhyst_coil_sum_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/control/generic/coil_flux.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
