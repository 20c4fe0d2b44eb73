/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of position.h in floating point. The caller selects the units, usually SI. A
   position, a load or a flux density that is NaN counts as missing. */
#ifndef ANHYST_POSITION_REAL_H
#define ANHYST_POSITION_REAL_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/levitation.h"
#include "anhyst/control/pidd2_real.h"

#define ANHYST_POSITION_MAGNETS 2

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/position_units.h"
#include "anhyst/control/generic/position.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/position_units.h"
#include "anhyst/control/generic/position.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
