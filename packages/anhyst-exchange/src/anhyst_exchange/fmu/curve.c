/* SPDX-License-Identifier: Apache-2.0 */
#include "curve.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"

#define MAX_LOGARITHM 700.0 /* exp overflows at 709.8 */

/* Cubic Hermite curve; a straight line if there are only two nodes. */
static double interpolate(const anhyst_curve *c, double at)
{
  int place = 0;
  double width, secant, way, bend, twist;
  if (c->nodes == 2) {
    return c->height[0] + c->slope[0] * (at - c->node[0]);
  }
  while (place < c->nodes - 2 && at >= c->node[place + 1]) {
    place++;
  }
  width = c->node[place + 1] - c->node[place];
  secant = (c->height[place + 1] - c->height[place]) / width;
  way = at - c->node[place];
  bend = (3.0 * secant - 2.0 * c->slope[place] - c->slope[place + 1]) / width;
  twist = (c->slope[place] + c->slope[place + 1] - 2.0 * secant) / (width * width);
  return c->height[place] + way * (c->slope[place] + way * (bend + way * twist));
}

static int from_coordinate(anhyst_coordinate coordinate, double coordinate_value, double *value)
{
  switch (coordinate) {
  case ANHYST_CURVE_RECIPROCAL:
    *value = 1.0 / coordinate_value;
    return coordinate_value > 0.0 && isfinite(*value) ? 0 : -1;
  case ANHYST_CURVE_LOG:
    *value = fabs(coordinate_value) <= MAX_LOGARITHM ? anhyst_exp_f64(coordinate_value) : 0.0;
    return fabs(coordinate_value) <= MAX_LOGARITHM ? 0 : -1;
  case ANHYST_CURVE_PLAIN:
  default:
    *value = coordinate_value;
    return isfinite(coordinate_value) ? 0 : -1;
  }
}

int anhyst_curve_at(const anhyst_curve *curve, double at, double *value)
{
  const int last = curve->nodes - 1;
  double inside = at;
  double coordinate_value = 0.0;
  int i;
  if (curve->nodes == 1) {
    *value = curve->value[0];
    return 0;
  }
  for (i = 0; i <= last; i++) {
    if (at == curve->node[i]) { /* a logarithm and its inverse change the last digit */
      *value = curve->value[i];
      return 0;
    }
  }
  inside = inside < curve->node[0] ? curve->node[0] : inside;
  inside = inside > curve->node[last] ? curve->node[last] : inside;
  coordinate_value = interpolate(curve, inside);
  coordinate_value += curve->slope[0] * fmin(at - curve->node[0], 0.0);
  coordinate_value += curve->slope[last] * fmax(at - curve->node[last], 0.0);
  return from_coordinate(curve->coordinate, coordinate_value, value);
}
