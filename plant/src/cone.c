/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "anhyst_plant/magnet.h"

#define MAX_ITERATIONS 100
#define MMF_TOLERANCE 1e-7 /* limit of the last step of the ampere-turns, A */

void anhyst_plant_evaluate_cone(const anhyst_plant_cone *cone, double gap,
                                anhyst_plant_cone_gap *at)
{
  const double width = cone->side + 2.0 * cone->fringe * gap;
  const double dip_depth = cone->depth - gap;
  const double root_term = sqrt(dip_depth * dip_depth + cone->onset * cone->onset);
  /* The second form avoids cancellation if the plunger is far outside. */
  const double overlap = dip_depth >= 0.0
                             ? 0.5 * (dip_depth + root_term)
                             : 0.5 * cone->onset * cone->onset / (root_term - dip_depth);
  const double d_overlap = -overlap / root_term;
  const double permeance_per_m = ANHYST_PLANT_MU0 * cone->around / cone->clearance;
  at->gap = gap;
  at->straight = ANHYST_PLANT_MU0 * width * width / gap + cone->leakage;
  at->d_face = ANHYST_PLANT_MU0 * (4.0 * cone->fringe * width / gap - width * width / (gap * gap));
  at->cone = permeance_per_m * overlap;
  at->d_cone = permeance_per_m * d_overlap;
  at->limit = cone->saturation * cone->around * (cone->thickness + cone->taper * overlap);
  at->d_limit = cone->saturation * cone->around * cone->taper * d_overlap;
}

static double cone_flux(const anhyst_plant_cone_gap *at, double mmf, double *slope)
{
  const double ratio = at->cone * mmf / at->limit;
  const double root = sqrt(1.0 + ratio * ratio);
  *slope = at->straight + at->cone / (root * root * root);
  return at->straight * mmf + at->cone * mmf / root;
}

/* The flux is an odd function and bends towards the axis of the ampere-turns. Therefore, after
   one Newton step, the iterates are below the solution and stay below. A step across zero restarts
   at zero, because steps on the other side could oscillate. */
double anhyst_plant_cone_mmf(const anhyst_plant_cone_gap *at, double flux, double near,
                             double *slope)
{
  double mmf = near;
  double step = HUGE_VAL;
  int i;
  for (i = 0; i < MAX_ITERATIONS && fabs(step) > MMF_TOLERANCE; i++) {
    const double flux_reached = cone_flux(at, mmf, slope);
    step = (flux - flux_reached) / *slope;
    mmf += step;
    if (flux < 0.0 ? mmf > 0.0 : mmf < 0.0) {
      mmf = 0.0;
      step = HUGE_VAL;
    }
  }
  (void)cone_flux(at, mmf, slope);
  *slope = 1.0 / *slope;
  return mmf;
}

double anhyst_plant_cone_force(const anhyst_plant_cone_gap *at, double mmf)
{
  const double ratio = at->cone * mmf / at->limit;
  const double root = sqrt(1.0 + ratio * ratio);
  const double by_cone = mmf * mmf / ((1.0 + root) * root);
  const double by_limit = by_cone * ratio * ratio * at->cone / ((1.0 + root) * at->limit);
  return -(0.5 * mmf * mmf * at->d_face + by_cone * at->d_cone + by_limit * at->d_limit);
}
