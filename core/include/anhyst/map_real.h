/* SPDX-License-Identifier: Apache-2.0 */
/* The table over force and gap of map.h in floating point. Declarations are in generic/map.h. */
#ifndef ANHYST_MAP_REAL_H
#define ANHYST_MAP_REAL_H

#include <stdint.h>

#include "anhyst/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/f64.h"
#include "anhyst/generic/map.h"
#include "anhyst/f32.h"
#include "anhyst/generic/map.h"
#include "anhyst/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
