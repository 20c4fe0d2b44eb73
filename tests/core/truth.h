/* SPDX-License-Identifier: Apache-2.0 */
/* The law in long double, written from its definitions with nothing taken from the core. */
#ifndef TEST_TRUTH_H
#define TEST_TRUTH_H

#include <stdint.h>

/* L(z) and L'(z) by power series without cancellation, or by hyperbolic functions. */
long double true_langevin(long double z);
long double true_langevin_slope(long double z);

/* The z with L(z) = y, by bisection and Newton. */
long double true_inverse_langevin(long double y);

/* The steady ascending branch: integral of exp(-s)*L(x - kappa*s) over s > 0; and its derivative by
   kappa, the integral of -s*exp(-s)*L'(x - kappa*s). 16-point Gauss panels. */
long double true_branch(long double kappa, long double x);
long double true_branch_slope(long double kappa, long double x);

/* Irreversible part of the effective-field law after a monotone path from x0 to x1. */
long double true_irreversible(long double kappa, long double x0, long double y0, long double x1);

/* The same for the law of 1986, by Runge-Kutta with very many steps. */
long double true_irreversible_1986(long double kappa, long double eps, long double x0,
                                   long double y0, long double x1);

/* Pseudo-random numbers, the same in every run. */
uint64_t random_bits(uint64_t *seed);
double uniform(uint64_t *seed, double low, double high);
double log_uniform(uint64_t *seed, double low, double high);

#endif
