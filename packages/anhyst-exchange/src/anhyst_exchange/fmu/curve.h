/* SPDX-License-Identifier: Apache-2.0 */
/* A parameter over the scheduling variable: a monotone cubic between the nodes, straight beyond, in
   the coordinate in which it is nearest to straight. As anhyst.model.gap_map. */
#ifndef ANHYST_CURVE_H
#define ANHYST_CURVE_H

typedef enum { ANHYST_CURVE_PLAIN, ANHYST_CURVE_RECIPROCAL, ANHYST_CURVE_LOG } anhyst_coordinate;

typedef struct {
  int nodes; /* 1: the first value, wherever */
  anhyst_coordinate coordinate;
  const double *node;   /* ascending */
  const double *value;  /* of the parameter there */
  const double *height; /* the same in the coordinate */
  const double *slope;  /* of the coordinate there */
} anhyst_curve;

/* 0, or -1 so far outside that the parameter leaves its range. */
int anhyst_curve_at(const anhyst_curve *curve, double at, double *value);

#endif
