/* SPDX-License-Identifier: Apache-2.0 */
/* The search for the field of an iron, inline with the evaluate_goal function of each family. */
#ifndef ANHYST_PLANT_SEARCH_H
#define ANHYST_PLANT_SEARCH_H

#include "anhyst_plant/iron.h"

#define ANHYST_PLANT_MAX_ITERATIONS 100
/* Newton iterations before bisection: if the field has folds, Newton's method may not converge. */
#define ANHYST_PLANT_NEWTON_ITERATIONS 30

/* Solves the equation of anhyst_plant_field by Newton's method within a bracket. */
static inline void anhyst_plant_search(anhyst_plant_look look, const anhyst_plant_iron *iron,
                                       const anhyst_plant_memory *memory, double a, double b,
                                       double r, double tolerance,
                                       const anhyst_plant_beyond *beyond, anhyst_plant_goal *goal)
{
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  double at = memory->at + memory->stride;
  int i;
  for (i = 0; i < ANHYST_PLANT_MAX_ITERATIONS; i++) {
    double slope = b;
    double residual;
    goal->at = at;
    look(iron, memory, goal);
    residual = r - a * goal->field - b * goal->density;
    if (beyond) {
      double steeper;
      residual -= beyond->needs(beyond->self, goal->density, &steeper);
      slope += steeper;
    }
    if (fabs(residual) <= tolerance) {
      return;
    }
    /* The left side rises by at least `a` per A/m of field, which gives a bracket. */
    if (residual > 0.0) {
      const double end = at + residual / a + iron->slack;
      low = at;
      high = end < high ? end : high;
    } else {
      const double end = at + residual / a - iron->slack;
      high = at;
      low = end > low ? end : low;
    }
    at += residual / (a * goal->field_slope + slope * goal->density_slope);
    if (i >= ANHYST_PLANT_NEWTON_ITERATIONS || !(at > low && at < high)) {
      at = 0.5 * (low + high);
    }
  }
  goal->at = at;
}

/* Defines the interface of a family from the functions evaluate_goal and move of its file. */
#define ANHYST_PLANT_DEFINE_FAMILY(name)                                                           \
  static void field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,    \
                    double b, double r, double tolerance, const anhyst_plant_beyond *beyond,       \
                    anhyst_plant_goal *goal)                                                       \
  {                                                                                                \
    anhyst_plant_search(evaluate_goal, iron, memory, a, b, r, tolerance, beyond, goal);            \
  }                                                                                                \
  const anhyst_plant_family anhyst_plant_of_##name = {evaluate_goal, field, move}

#endif
