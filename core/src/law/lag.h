/* SPDX-License-Identifier: Apache-2.0 */
/* How a law carries the irreversible part along a monotone path; one file a law. */
#ifndef ANHYST_LAG_H
#define ANHYST_LAG_H

#include "anhyst/law/operator.h"

typedef struct {
  /* Whether the parameters that are this law's own are within their ranges. */
  int (*is_valid)(const anhyst_operator_f64 *law);
  /* Upper bound of dm/dx. */
  double (*steepest)(const anhyst_operator_f64 *law);
  /* The irreversible part at p beyond the crossing of the anhysteretic curve, with pull = L(p),
     slope = L'(p); *y_slope, zero before, is dy/dp. */
  double (*carry)(anhyst_path_f64 *path, double p, double pull, double slope, double *y_slope);
} anhyst_lag;

extern const anhyst_lag anhyst_lag_exact;
extern const anhyst_lag anhyst_lag_linear;
extern const anhyst_lag anhyst_lag_1986;

/* The bound of a law whose irreversible part is nowhere steeper than the anhysteretic curve. */
double anhyst_lag_straight(const anhyst_operator_f64 *law);

/* Finds where the irreversible part departs. */
void anhyst_path_depart(anhyst_path_f64 *path);

#endif
