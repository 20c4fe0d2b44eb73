/* SPDX-License-Identifier: Apache-2.0 */
/* Selects single precision for the generic headers and sources that follow; see f64.h. */
#include "anhyst/numeric/names.h"

/* The checks of signals compare with NaN and infinity, which -ffast-math takes for impossible. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "anhyst needs NaN and infinity: compile without -ffast-math and -ffinite-math-only"
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
