/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/iron.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"

#define TWO_OVER_PI 0.63661977236758134308
#define ITERATIONS 100

/* Polarisation of a cell of weight 1, T, and its derivative by the cell's field. */
static double polarisation(const anhyst_plant_steel *steel, double h, double *slope)
{
  const double knee = steel->knee_sharp;
  const double inverse = 1.0 / sqrt(h * h + knee * knee);
  const double ratio = h / steel->knee_slow;
  const double slow = TWO_OVER_PI * steel->slow;
  *slope = steel->sharp * knee * knee * inverse * inverse * inverse +
           slow / (steel->knee_slow * (1.0 + ratio * ratio));
  return steel->sharp * h * inverse + slow * anhyst_atan_f64(ratio);
}

/* Looks at goal->field; returns the slope of the flux density on the way there. A cell at the edge
   of its play counts as moving: where the field stands, the slope is that of going on. */
static double look(const anhyst_plant_steel *steel, const anhyst_plant_cells *cells,
                   anhyst_plant_goal *goal)
{
  double density = ANHYST_PLANT_MU0 * goal->field;
  double slope = ANHYST_PLANT_MU0;
  int i;
  for (i = 0; i < steel->cells; i++) {
    const double away = goal->field - cells->place[i];
    const double r = steel->threshold[i];
    double steep;
    if (away < r && away > -r) {
      break;
    }
    goal->part[i] = steel->weight[i] *
                    polarisation(steel, away > 0.0 ? goal->field - r : goal->field + r, &steep);
    density += goal->part[i];
    slope += steel->weight[i] * steep;
  }
  goal->moved = i;
  goal->density = density + cells->rest[i];
  return slope;
}

void anhyst_plant_field(const anhyst_plant_steel *steel, const anhyst_plant_cells *cells, double a,
                        double b, double r, double tolerance, anhyst_plant_goal *goal)
{
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  int i;
  goal->field = cells->field + cells->stride;
  for (i = 0; i < ITERATIONS; i++) {
    const double slope = look(steel, cells, goal);
    const double left = r - a * goal->field - b * goal->density;
    if (fabs(left) <= tolerance) {
      break;
    }
    /* What is left falls by at least a for each A/m: a bracket. */
    if (left > 0.0) {
      const double end = goal->field + left / a;
      low = goal->field;
      high = end < high ? end : high;
    } else {
      const double end = goal->field + left / a;
      high = goal->field;
      low = end > low ? end : low;
    }
    goal->field += left / (a + b * slope);
    if (!(goal->field > low && goal->field < high)) {
      goal->field = 0.5 * (low + high);
    }
  }
}

void anhyst_plant_move(const anhyst_plant_steel *steel, anhyst_plant_cells *cells,
                       const anhyst_plant_goal *goal)
{
  int i;
  for (i = goal->moved - 1; i >= 0; i--) {
    const double r = steel->threshold[i];
    cells->place[i] = goal->field > cells->place[i] ? goal->field - r : goal->field + r;
    cells->rest[i] = cells->rest[i + 1] + goal->part[i];
  }
  cells->stride = goal->field - cells->field;
  cells->field = goal->field;
  cells->density = ANHYST_PLANT_MU0 * goal->field + cells->rest[0];
}
