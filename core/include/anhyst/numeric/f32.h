/* SPDX-License-Identifier: Apache-2.0 */
/* Selects single precision for the generic headers and sources that follow; see f64.h. */
#include "anhyst/numeric/names.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "-ffast-math and -ffinite-math-only take away the checks for signals that are not numbers"
#endif

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
