/* SPDX-License-Identifier: Apache-2.0 */
/* The Langevin function, its slope and its inverse. */
#ifndef ANHYST_LANGEVIN_H
#define ANHYST_LANGEVIN_H

#ifdef __cplusplus
extern "C" {
#endif

/* L(z) = coth(z) - 1/z and, in *slope, L'(z); any finite z.
   |z| < 1.5: convergent of the continued fraction, 10 levels, as one
   quotient of polynomials with positive coefficients. Else: exponential form.
   Relative error, L and L': 4e-16 and 1.7e-15. */
double anhyst_langevin_f64(double z, double *slope);

/* The z with L(z) = y; |y| < 1. Newton from a rational start; relative error of a few units in
   the last place, growing as 1/(1 - |y|) as the inverse itself does. */
double anhyst_inverse_langevin_f64(double y);

#ifdef __cplusplus
}
#endif
#endif
