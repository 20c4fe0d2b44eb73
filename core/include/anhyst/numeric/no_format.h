/* SPDX-License-Identifier: Apache-2.0 */
/* Forgets the number format selected by f64.h or f32.h; ends every public header. */
#undef ANHYST_REAL
#undef ANHYST_NAME
#undef ANHYST_SQRT
#undef ANHYST_FABS
#undef ANHYST_EPS
#undef R
