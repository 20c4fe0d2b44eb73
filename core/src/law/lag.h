/* SPDX-License-Identifier: Apache-2.0 */
/* Methods that advance the irreversible magnetisation along a monotonic path, one in each file. */
#ifndef ANHYST_LAG_H
#define ANHYST_LAG_H

#include "anhyst/law/operator.h"

typedef struct {
  /* Returns whether the parameters are in the ranges of this method. */
  int (*is_law_valid)(const anhyst_operator_f64 *law);
  double (*steepest_slope)(const anhyst_operator_f64 *law);
  /* Returns the irreversible magnetisation at p, after the path has crossed the anhysteretic curve.
     The arguments are pull = L(p) and slope = L'(p). Sets *y_slope, which was zero, to dy/dp. */
  double (*irreversible_m)(anhyst_path_f64 *path, double p, double pull, double slope,
                           double *y_slope);
} anhyst_lag;

extern const anhyst_lag anhyst_lag_exact;
extern const anhyst_lag anhyst_lag_linear;
extern const anhyst_lag anhyst_lag_1986;

/* Returns the largest slope of a law that is never steeper than the anhysteretic curve. */
double anhyst_lag_max_slope(const anhyst_operator_f64 *law);

void anhyst_path_find_y_start(anhyst_path_f64 *path);

#endif
