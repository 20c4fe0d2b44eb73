/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/iron.h"

#include <math.h>

#define TWO_OVER_PI 0.63661977236758134308
#define ITERATIONS 100

static double clip(double x, double low, double high)
{
  return x < low ? low : (x > high ? high : x);
}

/* Polarisation of a cell of weight 1, T, and its derivative by the cell's field. */
static double polarisation(const anhyst_plant_steel *steel, double h, double *slope)
{
  const double knee = steel->knee_sharp;
  const double inverse = 1.0 / sqrt(h * h + knee * knee);
  const double ratio = h / steel->knee_slow;
  const double slow = TWO_OVER_PI * steel->slow;
  *slope = steel->sharp * knee * knee * inverse * inverse * inverse +
           slow / (steel->knee_slow * (1.0 + ratio * ratio));
  return steel->sharp * h * inverse + slow * atan(ratio);
}

/* Flux density if the field moved there, and its slope on the way. A cell at the edge of its play
   counts as moving: where the field stands, the slope is that of going on. */
static double density_at(const anhyst_plant_steel *steel, const anhyst_plant_cells *cells,
                         double field, double *slope)
{
  double density = ANHYST_PLANT_MU0 * field;
  int i;
  *slope = ANHYST_PLANT_MU0;
  for (i = 0; i < steel->cells; i++) {
    const double r = steel->threshold[i];
    double steep;
    if (fabs(field - cells->place[i]) < r) {
      break;
    }
    density +=
        steel->weight[i] * polarisation(steel, clip(cells->place[i], field - r, field + r), &steep);
    *slope += steel->weight[i] * steep;
  }
  for (; i < steel->cells; i++) {
    density += cells->part[i];
  }
  return density;
}

double anhyst_plant_field(const anhyst_plant_steel *steel, const anhyst_plant_cells *cells,
                          double a, double b, double r, double tolerance, double *density)
{
  double field = cells->field + cells->stride;
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  int i;
  for (i = 0; i < ITERATIONS; i++) {
    double slope;
    double left;
    *density = density_at(steel, cells, field, &slope);
    left = r - a * field - b * *density;
    if (fabs(left) <= tolerance) {
      break;
    }
    /* What is left falls by at least a for each A/m: a bracket. */
    if (left > 0.0) {
      low = field;
      high = fmin(high, field + left / a);
    } else {
      high = field;
      low = fmax(low, field + left / a);
    }
    field += left / (a + b * slope);
    if (!(field > low && field < high)) {
      field = 0.5 * (low + high);
    }
  }
  return field;
}

void anhyst_plant_move(const anhyst_plant_steel *steel, anhyst_plant_cells *cells, double field)
{
  double density = ANHYST_PLANT_MU0 * field;
  int i;
  for (i = 0; i < steel->cells; i++) {
    const double r = steel->threshold[i];
    double steep;
    if (fabs(field - cells->place[i]) <= r && r > 0.0) {
      break;
    }
    cells->place[i] = clip(cells->place[i], field - r, field + r);
    cells->part[i] = steel->weight[i] * polarisation(steel, cells->place[i], &steep);
  }
  for (i = 0; i < steel->cells; i++) {
    density += cells->part[i];
  }
  cells->stride = field - cells->field;
  cells->field = field;
  cells->density = density;
}
