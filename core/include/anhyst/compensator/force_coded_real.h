/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller in SI units that asks one in fixed point, whatever its method: floating point
   outside, codes of q31 inside. The memory of the iron is that of the inner one.

   A code is its signal cut off towards zero; what is beyond the format becomes its end, a gap
   beyond its range the end of that. Error: one code, 2^-31 of full scale, and 2 units in the last
   place of the signal in the outer format, which in single precision are the larger part: 2.4e-7 of
   a force, a current, or the distance of a gap from gap_low. A force or gap that is no number asks
   for the lowest force; a flux density that is none is that of no probe. Nothing here waits or
   loops. Declarations are in generic/force_coded.h. */
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
