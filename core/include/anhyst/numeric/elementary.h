/* SPDX-License-Identifier: Apache-2.0 */
/* Elementary functions with identical bits on every processor. C libraries differ in the last bits.
   The functions of this header consist of sums, products and quotients only. The results are
   identical if these operations are rounded as IEEE 754 defines and no product is fused into a sum.
   The square root is not included because IEEE 754 defines it exactly. */
#ifndef ANHYST_ELEMENTARY_H
#define ANHYST_ELEMENTARY_H

#ifdef __cplusplus
extern "C" {
#endif

/* Each function accepts any argument; limits and NaN are those of the C library. Errors: 0.6 ulp
   for exp (0.8 ulp for subnormal results), 0.7 ulp for atan, 1.1 ulp for log. */
double anhyst_exp_f64(double x);
double anhyst_log_f64(double x);
double anhyst_atan_f64(double x);

#ifdef __cplusplus
}
#endif
#endif
