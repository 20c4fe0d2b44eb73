/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst_plant/search.h"

/* Returns the parabola over the polarisation that h approaches on a rising path, A/m. */
static double limit_parabola(const anhyst_plant_duhem_steel *steel, double polarisation)
{
  const double saturation = steel->curve.sharp + steel->curve.slow;
  const double inverse_rate = 1.0 / (steel->rate * saturation);
  const double j = polarisation / saturation;
  const double fading_term = j * j - 2.0 * inverse_rate * j + 2.0 * inverse_rate * inverse_rate;
  return steel->coercivity * (1.0 - steel->fading * fading_term);
}

static inline void evaluate_goal(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                                 anhyst_plant_goal *goal)
{
  const anhyst_plant_duhem_steel *steel = &iron->steel.duhem;
  const anhyst_plant_duhem *start = &memory->own.duhem;
  anhyst_plant_duhem *end = &goal->own.duhem;
  const double saturation = steel->curve.sharp + steel->curve.slow;
  const double travel = goal->at == memory->at ? memory->stride : goal->at - memory->at;
  const double direction = travel < 0.0 ? -1.0 : 1.0;
  double slope;
  double q;
  double share;
  end->polarisation = anhyst_plant_polarisation(&steel->curve, goal->at, &slope);
  share = end->polarisation / saturation;
  q = steel->rate * steel->coercivity * (1.0 - steel->fading * share * share);
  end->friction =
      direction * limit_parabola(steel, direction * end->polarisation) +
      (start->friction - direction * limit_parabola(steel, direction * start->polarisation)) *
          anhyst_exp_f64(-steel->rate * fabs(end->polarisation - start->polarisation));
  goal->field = goal->at + end->friction;
  goal->field_slope = 1.0 + (q - direction * steel->rate * end->friction) * slope;
  goal->density = ANHYST_PLANT_MU0 * goal->field + end->polarisation;
  goal->density_slope = ANHYST_PLANT_MU0 * goal->field_slope + slope;
}

static void move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                 const anhyst_plant_goal *goal)
{
  (void)iron;
  memory->own.duhem = goal->own.duhem;
  memory->density = goal->density;
}

ANHYST_PLANT_DEFINE_FAMILY(duhem);
