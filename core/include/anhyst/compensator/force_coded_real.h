/* SPDX-License-Identifier: Apache-2.0 */
/* An adapter with signals in SI units (floating point) for a force controller in q31 codes. The
   inner controller may use any method, and contains the hysteresis state.

   Signals are truncated towards zero to codes. A signal outside the format becomes the nearest end
   of the format, and a gap outside its range becomes the nearest end of the range. The error is one
   code (2^-31 of full scale) plus 2 ulp of the signal in the floating-point format. In single
   precision, this second part is larger: 2.4e-7 of a force, a current, or the distance of a gap
   from gap_low. A force or a gap that is NaN demands the lowest force. A flux density that is NaN
   means that there is no probe. No function waits or contains a loop. Declarations:
   generic/force_coded.h. */
#ifndef ANHYST_FORCE_CODED_REAL_H
#define ANHYST_FORCE_CODED_REAL_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/compensator/force_controller_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/force_coded.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/force_coded.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
