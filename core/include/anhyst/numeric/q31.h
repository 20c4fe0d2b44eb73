/* SPDX-License-Identifier: Apache-2.0 */
/* Selects q31 for the generic headers and sources that are included next; see f64.h. */
#include "anhyst/numeric/names.h"

#undef ANHYST_REAL
#undef ANHYST_NAME
#define ANHYST_REAL int32_t
#define ANHYST_NAME(base) base##_q31
