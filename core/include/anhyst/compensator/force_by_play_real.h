/* SPDX-License-Identifier: Apache-2.0 */
/* The method `play` of force_controller.h in floating point: a map with one play operator. */
#ifndef ANHYST_FORCE_BY_PLAY_REAL_H
#define ANHYST_FORCE_BY_PLAY_REAL_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/compensator/play_map_real.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/force_by_play.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/force_by_play.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
