/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller that measures the voltage of a coil instead of a flux density, in fixed point.
   The voltage is that of a sense coil around the iron (resistance 0), or of the winding itself. In
   each tick, `solve` receives the mean voltage of the last tick in place of the flux density. The
   flux of an inner force controller with the method `flux` or `fused` is then a flux linkage:

     law        = expected + inductance*correction     flux that the inner controller expects
     drift      = gain*u - resistance*i - offset - (law - law of the last tick)
     offset     = offset + pull*drift                  limited to -offset..offset
     resistance = resistance + 32*pull*drift*i         if |i| >= 1/4; limited to +-spread
     pull       = pull - pull^2                        at least the given pull
     e          = e + drift                            deviation from the law
     e          = e - (pull*(2*law)^2 + pull - given pull)*e
     flux       = law + e                              measured flux of the inner controller

   The law gives the flux at standstill, and the voltage gives every faster change. The error of the
   law is smallest at a large flux. Therefore, the pull to the law grows with the square of the
   flux. The sum of all drifts is the change of e. Therefore, an error of the law that returns to
   its value does not change the offset. Small currents do not teach the resistance, because the
   remanence of the iron would be taken for a resistance. If the deviation reaches `reach` for
   ANHYST_COIL_DOUBT_TICKS ticks, offset or resistance are wrong: e becomes 0, and the pull rises by
   the factor ANHYST_COIL_HASTE. While a limit of demand, current or flux is active, the law does
   not describe the iron. Then, nothing pulls e. A missing voltage, or one at the end of its range,
   sets e to 0. `i` is the committed current, delayed to the middle of the last tick. Only the first
   solve of a tick integrates.

   Formats: signals are q31 codes of their full scales. The sums have 60 fractional bits. No
   operation overflows, and each sum stays within its limits (proved). Over 6000 ticks, the sums
   differ from double precision by less than 2e-6 of full scale; single precision by 3e-5
   (tested). */
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
