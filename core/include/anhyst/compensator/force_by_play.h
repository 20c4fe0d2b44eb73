/* SPDX-License-Identifier: Apache-2.0 */
/* The method `play` of force_controller.h in fixed point: a map with one play operator. The header
   is separate so that programs without the method do not link its code. */
#ifndef ANHYST_FORCE_BY_PLAY_H
#define ANHYST_FORCE_BY_PLAY_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/compensator/play_map.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/q31.h"
#include "anhyst/compensator/generic/force_by_play.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
