/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/iron.h"

#include <math.h>

#define ITERATIONS 100
/* Iterations before the bracket is halved: where a field has folds, tangents may lead nowhere. */
#define HALVED 30

void anhyst_plant_field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                        double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                        anhyst_plant_goal *goal)
{
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  int i;
  goal->at = memory->at + memory->stride;
  for (i = 0; i < ITERATIONS; i++) {
    double slope = b;
    double left;
    iron->family->look(iron, memory, goal);
    left = r - a * goal->field - b * goal->density;
    if (beyond) {
      double steeper;
      left -= beyond->needs(beyond->self, goal->density, &steeper);
      slope += steeper;
    }
    if (fabs(left) <= tolerance) {
      break;
    }
    /* What is left falls by at least a for each A/m of field: a bracket. */
    if (left > 0.0) {
      const double end = goal->at + left / a + iron->slack;
      low = goal->at;
      high = end < high ? end : high;
    } else {
      const double end = goal->at + left / a - iron->slack;
      high = goal->at;
      low = end > low ? end : low;
    }
    goal->at += left / (a * goal->field_slope + slope * goal->density_slope);
    if (i >= HALVED || !(goal->at > low && goal->at < high)) {
      goal->at = 0.5 * (low + high);
    }
  }
}

void anhyst_plant_move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                       const anhyst_plant_goal *goal)
{
  iron->family->move(iron, memory, goal);
  memory->stride = goal->at - memory->at;
  memory->at = goal->at;
  memory->field = goal->field;
}
