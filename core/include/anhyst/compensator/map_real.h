/* SPDX-License-Identifier: Apache-2.0 */
/* The map of map.h in floating point. Declarations: generic/map.h. */
#ifndef ANHYST_MAP_REAL_H
#define ANHYST_MAP_REAL_H

#include <stdint.h>

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/map.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/map.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
