/* SPDX-License-Identifier: Apache-2.0 */
/* A parameter as a function of the scheduling variable: a monotone cubic between the nodes and a
 * straight line outside, in the coordinate in which the parameter is closest to a straight line.
 * Equals anhyst.model.gap_map. */
#ifndef ANHYST_CURVE_H
#define ANHYST_CURVE_H

typedef enum { ANHYST_CURVE_PLAIN, ANHYST_CURVE_RECIPROCAL, ANHYST_CURVE_LOG } anhyst_coordinate;

typedef struct {
  int nodes; /* number of nodes; 1: the first value everywhere */
  anhyst_coordinate coordinate;
  const double *node;   /* nodes, ascending */
  const double *value;  /* parameter at the nodes */
  const double *height; /* coordinate at the nodes */
  const double *slope;  /* slope of the coordinate at the nodes */
} anhyst_curve;

/* Returns 0, or -1 if the parameter leaves its range far outside the nodes. */
int anhyst_curve_at(const anhyst_curve *curve, double at, double *value);

#endif
