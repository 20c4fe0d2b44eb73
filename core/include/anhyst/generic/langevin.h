/* SPDX-License-Identifier: Apache-2.0 */

/* L(z) = coth(z) - 1/z and, in *slope, L'(z); any finite z.
   |z| < 1.5: convergent of the continued fraction, 10 levels (double) or 5 (single), as one
   quotient of polynomials with positive coefficients. Else: exponential form.
   Relative error, L and L': 4e-16 and 1.7e-15 (double), 2.5e-7 and 1.1e-6 (single). */
ANHYST_REAL ANHYST_NAME(anhyst_langevin)(ANHYST_REAL z, ANHYST_REAL *slope);

/* The z with L(z) = y; |y| < 1. Newton from a rational start; relative error of a few units in
   the last place, growing as 1/(1 - |y|) as the inverse itself does. */
ANHYST_REAL ANHYST_NAME(anhyst_inverse_langevin)(ANHYST_REAL y);
