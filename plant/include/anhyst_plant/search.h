/* SPDX-License-Identifier: Apache-2.0 */
/* The search for the field of an iron. Inline: each family compiles it with its own look(). */
#ifndef ANHYST_PLANT_SEARCH_H
#define ANHYST_PLANT_SEARCH_H

#include "anhyst_plant/iron.h"

/* Maximum number of iterations. */
#define ANHYST_PLANT_MAX_ITERATIONS 100
/* Iterations before the bracket is halved: if a field has folds, tangents may lead nowhere. */
#define ANHYST_PLANT_NEWTON_ITERATIONS 30

/* Solves what anhyst_plant_field states: Newton's method within a bracket. */
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
    double missing;
    goal->at = at;
    look(iron, memory, goal);
    missing = r - a * goal->field - b * goal->density;
    if (beyond) {
      double steeper;
      missing -= beyond->needs(beyond->self, goal->density, &steeper);
      slope += steeper;
    }
    if (fabs(missing) <= tolerance) {
      return;
    }
    /* What is missing falls by at least a for each A/m of field: a bracket. */
    if (missing > 0.0) {
      const double end = at + missing / a + iron->slack;
      low = at;
      high = end < high ? end : high;
    } else {
      const double end = at + missing / a - iron->slack;
      high = at;
      low = end > low ? end : low;
    }
    at += missing / (a * goal->field_slope + slope * goal->density_slope);
    if (i >= ANHYST_PLANT_NEWTON_ITERATIONS || !(at > low && at < high)) {
      at = 0.5 * (low + high);
    }
  }
  goal->at = at;
}

/* The table of a family, of the look() and move() of its file. */
#define ANHYST_PLANT_FAMILY(name)                                                                  \
  static void field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,    \
                    double b, double r, double tolerance, const anhyst_plant_beyond *beyond,       \
                    anhyst_plant_goal *goal)                                                       \
  {                                                                                                \
    anhyst_plant_search(look, iron, memory, a, b, r, tolerance, beyond, goal);                     \
  }                                                                                                \
  const anhyst_plant_family anhyst_plant_of_##name = {look, field, move}

#endif
