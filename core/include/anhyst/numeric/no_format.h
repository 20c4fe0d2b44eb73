/* SPDX-License-Identifier: Apache-2.0 */
/* Undefines the macros of f64.h, f32.h and q31.h. Every public header ends with this file. */
#undef ANHYST_REAL
#undef ANHYST_NAME
#undef ANHYST_SQRT
#undef ANHYST_FABS
#undef ANHYST_EPS
#undef R
