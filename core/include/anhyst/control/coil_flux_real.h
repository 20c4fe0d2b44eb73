/* SPDX-License-Identifier: Apache-2.0 */
/* The force controller of coil_flux.h in floating point, in SI units: V, A, Wb and s. A voltage of
   NaN means that it was not measured. */
#ifndef ANHYST_COIL_FLUX_REAL_H
#define ANHYST_COIL_FLUX_REAL_H

#include "anhyst/compensator/force_controller_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/coil_flux_settings.h"
#include "anhyst/control/generic/coil_flux.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/coil_flux_settings.h"
#include "anhyst/control/generic/coil_flux.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
