/* SPDX-License-Identifier: Apache-2.0 */
/* A second-order filter in floating point, for example a notch, a low-pass or a PID controller. */
#ifndef ANHYST_BIQUAD_H
#define ANHYST_BIQUAD_H

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/biquad.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/biquad.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
