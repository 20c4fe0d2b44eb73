/* SPDX-License-Identifier: Apache-2.0 */
/* Methods that advance the irreversible part along a monotone path; one file for each. */
#ifndef ANHYST_LAG_H
#define ANHYST_LAG_H

#include "anhyst/law/operator.h"

typedef struct {
  /* Returns whether the parameters of this method are in their ranges. */
  int (*is_law_valid)(const anhyst_operator_f64 *law);
  double (*steepest_slope)(const anhyst_operator_f64 *law);
  /* Returns the irreversible part at p, after the crossing of the anhysteretic curve, with pull =
     L(p) and slope = L'(p). Sets *y_slope, which was zero, to dy/dp. */
  double (*irreversible_m)(anhyst_path_f64 *path, double p, double pull, double slope,
                           double *y_slope);
} anhyst_lag;

extern const anhyst_lag anhyst_lag_exact;
extern const anhyst_lag anhyst_lag_linear;
extern const anhyst_lag anhyst_lag_1986;

/* Returns the bound if the irreversible part is nowhere steeper than the anhysteretic curve. */
double anhyst_lag_max_slope(const anhyst_operator_f64 *law);

void anhyst_path_find_irreversible_start(anhyst_path_f64 *path);

#endif
