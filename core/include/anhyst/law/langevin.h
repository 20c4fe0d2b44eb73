/* SPDX-License-Identifier: Apache-2.0 */
/* The Langevin function, its slope and its inverse. */
#ifndef ANHYST_LANGEVIN_H
#define ANHYST_LANGEVIN_H

#ifdef __cplusplus
extern "C" {
#endif

/* Returns L(z) = coth(z) - 1/z and, in *slope, L'(z), for any finite z. For |z| < 1.5, uses 10
   levels of the continued fraction, as a quotient of polynomials with positive coefficients. For
   other z, uses the exponential form. The relative errors of L and L' are 4e-16 and 1.7e-15. */
double anhyst_langevin_f64(double z, double *slope);

/* Returns the z with L(z) = y, for |y| < 1, by Newton's method from a rational start value. The
   relative error is a few ulp and rises in proportion to 1/(1 - |y|), as the inverse does. */
double anhyst_inverse_langevin_f64(double y);

#ifdef __cplusplus
}
#endif
#endif
