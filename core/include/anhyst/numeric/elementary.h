/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that C libraries compute with other last bits on other processors: here they are sums,
   products and quotients alone, the same bits wherever these are rounded as IEEE 754 says and no
   product is fused into a sum. The square root is exact everywhere and needs no place here. */
#ifndef ANHYST_ELEMENTARY_H
#define ANHYST_ELEMENTARY_H

#ifdef __cplusplus
extern "C" {
#endif

/* Any argument, with the limits and NaN of the C library. Error, in units of the last place: 0.6
   for exp (0.8 below the normal numbers), 0.7 for atan, 1.1 for log. */
double anhyst_exp_f64(double x);
double anhyst_log_f64(double x);
double anhyst_atan_f64(double x);

#ifdef __cplusplus
}
#endif
#endif
