/* SPDX-License-Identifier: Apache-2.0 */
/* The law in long double, from its definitions, without any code of the core. */
#ifndef TEST_TRUTH_H
#define TEST_TRUTH_H

#include <stdint.h>

/* Return L(z) and L'(z) by power series without cancellation, or by hyperbolic functions. */
long double true_langevin(long double z);
long double true_langevin_slope(long double z);

/* Returns the z with L(z) = y, by bisection and Newton's method. */
long double true_inverse_langevin(long double y);

/* Return the steady ascending branch, the integral of exp(-s)*L(x - kappa*s) over s > 0, and its
   derivative by kappa, the integral of -s*exp(-s)*L'(x - kappa*s). 16-point Gauss panels. */
long double true_branch(long double kappa, long double x);
long double true_branch_slope(long double kappa, long double x);

/* Returns the irreversible part of the effective-field law after a monotone path from x0 to x1. */
long double true_irreversible(long double kappa, long double x0, long double y0, long double x1);

/* Returns the same for the law of 1986, by Runge-Kutta with a very large number of steps. */
long double true_irreversible_1986(long double kappa, long double eps, long double x0,
                                   long double y0, long double x1);

/* Return pseudo-random numbers, the same in every run. */
uint64_t random_bits(uint64_t *seed);
double uniform(uint64_t *seed, double low, double high);
double log_uniform(uint64_t *seed, double low, double high);

#endif
