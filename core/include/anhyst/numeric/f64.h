/* SPDX-License-Identifier: Apache-2.0 */
/* Selects double precision for the generic headers and sources that are included next. This header
   has no include guard, because a file includes f64.h and f32.h one after the other. Both number
   formats then exist in parallel under their own names (_f64 and _f32). */
#include "anhyst/numeric/names.h"

#undef ANHYST_REAL
#undef ANHYST_NAME
#undef ANHYST_SQRT
#undef ANHYST_FABS
#undef ANHYST_EPS
#undef R
#define ANHYST_REAL double
#define ANHYST_NAME(base) base##_f64
#define ANHYST_SQRT sqrt
#define ANHYST_FABS fabs
#define ANHYST_EPS 2.220446049250313e-16
#define R(literal) (literal)
