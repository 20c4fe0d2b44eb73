/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller in SI units that asks one in fixed point, whatever its method: floating point
   outside, codes of q31 inside. The memory of the iron is that of the inner one.

   A code is the nearest to its signal, one that is beyond the format its end. Error: half a code,
   and of the signal 3 units in the last place of the outer format, which in single precision is
   the larger part: 2e-7 of the force, of the current and, of its range, of the gap (where this is
   the difference to gap_low, rounded once more with the gap). A gap beyond the range counts as its
   end. A force or gap that is no number asks for the lowest force; a flux density that is none is
   that of no probe. Declarations are in generic/force_coded.h. */
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
