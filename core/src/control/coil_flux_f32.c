/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/coil_flux_real.h"

#include <stddef.h>

#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/real.h"
#include "anhyst/numeric/f32.h"
#include "generic/coil_flux_real.h"
#include "generic/coil_flux.h"
