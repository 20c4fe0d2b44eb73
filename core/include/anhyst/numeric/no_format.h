/* SPDX-License-Identifier: Apache-2.0 */
/* Clears the number format of f64.h, f32.h or q31.h. Every public header ends with it. */
#undef ANHYST_REAL
#undef ANHYST_NAME
#undef ANHYST_SQRT
#undef ANHYST_FABS
#undef ANHYST_EPS
#undef R
