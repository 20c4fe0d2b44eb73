/* SPDX-License-Identifier: Apache-2.0 */
/* Selects single precision for the generic headers and sources that follow; see f64.h. */
#include "anhyst/numeric/names.h"

#undef ANHYST_REAL
#undef ANHYST_NAME
#undef ANHYST_SQRT
#undef ANHYST_FABS
#undef ANHYST_EPS
#undef R
#define ANHYST_REAL float
#define ANHYST_NAME(base) base##_f32
#define ANHYST_SQRT sqrtf
#define ANHYST_FABS fabsf
#define ANHYST_EPS 1.1920929e-7f
#define R(literal) (literal##f)
