/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play of play_map.h in floating point, in the units of the model. A demand or a
   gap that is not a number counts as its lowest value; an applied current that is none leaves the
   play alone. */
#ifndef ANHYST_PLAY_MAP_REAL_H
#define ANHYST_PLAY_MAP_REAL_H

#include "anhyst/compensator/flags.h"
#include "anhyst/compensator/map_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/play_law.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/play_law.h"
#include "anhyst/compensator/generic/play_map.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
