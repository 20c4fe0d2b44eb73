/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller that applies a calibration, in floating point. The inner controller may use
   any method. If the inner controller was identified on another magnet, gap, flux density and
   current are converted between the two magnets. The eddy-current lag is compensated.

     current = (inner(demand, gap - zero, flux*density) + lead*(sqrt(demand) - sqrt(before)))/scale

   The second term is the current whose field cancels that of the eddy currents. The flux density is
   proportional to the square root of the force, and the second term advances this density by the
   time of the lag. The inner controller commits the current without this term. */
#ifndef ANHYST_FORCE_CORRECTED_REAL_H
#define ANHYST_FORCE_CORRECTED_REAL_H

#include "anhyst/compensator/force_controller_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/force_corrected.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/force_corrected.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
