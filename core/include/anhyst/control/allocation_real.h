/* SPDX-License-Identifier: Apache-2.0 */
/* The allocation of allocation.h in floating point. */
#ifndef ANHYST_ALLOCATION_REAL_H
#define ANHYST_ALLOCATION_REAL_H

#include <stdint.h>

#include "anhyst/control/allocation_kinds.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/allocation.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/allocation.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
