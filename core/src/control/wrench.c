/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/wrench.h"

#include <math.h>
#include <stddef.h>

#define AXES ANHYST_WRENCH_AXES
#define DRIVES ANHYST_WRENCH_DRIVES

/* Least part of its row that a pivot keeps: less is no axis of its own, or in single precision
   noise of the forces. A row that has lost nearly all counts as if it had kept so much of its 1:
   what is left of it may be rounding. */
#define LEAST_PIVOT (ANHYST_EPS > R(1e-10) ? R(1e-2) : R(1e-6))
#define LEAST_ROW R(1e-2)

/* Part of the least force by which rounding may miss it. */
#define ROUNDING (ANHYST_EPS > R(1e-10) ? R(1e-4) : R(1e-12))

#include "anhyst/numeric/f64.h"
#include "generic/wrench.h"
#include "anhyst/numeric/f32.h"
#include "generic/wrench.h"
