/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller behind what calibration found of its magnet, in floating point: whatever its
   method, it is asked as if current, gap, flux and time were what it was fitted to.

     current = (inner(demand, gap - zero, flux*density) + lead*(sqrt(demand) - sqrt(before)))/scale

   The last sum is what eddy currents take of the ampere-turns: the flux density goes with the root
   of the force, and is led by as much as it lags. Committed is what the iron is left with. */
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
