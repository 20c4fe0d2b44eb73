/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "anhyst_plant/magnet.h"

#define ITERATIONS 100
#define TOLERANCE 1e-7 /* of the ampere-turns, A; the step that is taken then ends far closer */

void anhyst_plant_cone_at(const anhyst_plant_cone *cone, double gap, anhyst_plant_cone_gap *at)
{
  const double width = cone->side + 2.0 * cone->fringe * gap;
  const double dip = cone->depth - gap;
  const double reach = sqrt(dip * dip + cone->onset * cone->onset);
  /* The second form loses no digits where the plunger is far out. */
  const double overlap =
      dip >= 0.0 ? 0.5 * (dip + reach) : 0.5 * cone->onset * cone->onset / (reach - dip);
  const double d_overlap = -overlap / reach;
  const double by_length = ANHYST_PLANT_MU0 * cone->around / cone->clearance;
  at->gap = gap;
  at->straight = ANHYST_PLANT_MU0 * width * width / gap + cone->leakage;
  at->d_face = ANHYST_PLANT_MU0 * (4.0 * cone->fringe * width / gap - width * width / (gap * gap));
  at->cone = by_length * overlap;
  at->d_cone = by_length * d_overlap;
  at->limit = cone->saturation * cone->around * (cone->thickness + cone->taper * overlap);
  at->d_limit = cone->saturation * cone->around * cone->taper * d_overlap;
}

static double flux_at(const anhyst_plant_cone_gap *at, double mmf, double *slope)
{
  const double ratio = at->cone * mmf / at->limit;
  const double root = sqrt(1.0 + ratio * ratio);
  *slope = at->straight + at->cone / (root * root * root);
  return at->straight * mmf + at->cone * mmf / root;
}

/* The flux is odd and bends towards the axis of the ampere-turns, so that Newton's steps end below
   after one, and stay below. One past zero begins there: on the other side they may go to and fro
   for ever. */
double anhyst_plant_cone_mmf(const anhyst_plant_cone_gap *at, double flux, double near,
                             double *slope)
{
  double mmf = near;
  double step = HUGE_VAL;
  int i;
  for (i = 0; i < ITERATIONS && fabs(step) > TOLERANCE; i++) {
    const double reached = flux_at(at, mmf, slope);
    step = (flux - reached) / *slope;
    mmf += step;
    if (flux < 0.0 ? mmf > 0.0 : mmf < 0.0) {
      mmf = 0.0;
      step = HUGE_VAL;
    }
  }
  (void)flux_at(at, mmf, slope);
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
