/* SPDX-License-Identifier: Apache-2.0 */
/* A force controller that applies the calibration of its magnet to another one, in floating point.
   The inner controller may use any method. Its current, gap and flux are converted to those of the
   magnet for which it was identified, and the eddy-current lag is compensated.

     current = (inner(demand, gap - zero, flux*density) + lead*(sqrt(demand) - sqrt(before)))/scale

   The second term is the ampere-turns that oppose eddy currents: the flux density is proportional
   to the square root of the force, and leads by as much as it lags. The inner controller commits
   the current without this term. */
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
