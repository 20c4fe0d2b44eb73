/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of tracking.h in floating point, in the units of the model. */
#ifndef ANHYST_TRACKING_REAL_H
#define ANHYST_TRACKING_REAL_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/allocation_real.h"
#include "anhyst/control/biquad_real.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef anhyst_biquad_f64 anhyst_pid_f64;
typedef anhyst_biquad_state_f64 anhyst_pid_state_f64;
typedef anhyst_biquad_f32 anhyst_pid_f32;
typedef anhyst_biquad_state_f32 anhyst_pid_state_f32;

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/tracking.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/tracking.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
