/* SPDX-License-Identifier: Apache-2.0 */
/* The position controller of pidd2.h in floating point. Declarations: generic/pidd2.h. */
#ifndef ANHYST_PIDD2_REAL_H
#define ANHYST_PIDD2_REAL_H

#include "anhyst/numeric/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/pidd2.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/pidd2.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
