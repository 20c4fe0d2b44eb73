/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst_plant/search.h"

/* The parabola over the polarisation to which h goes while that rises, A/m. */
static double parabola(const anhyst_plant_duhem_steel *steel, double polarisation)
{
  const double saturation = steel->curve.sharp + steel->curve.slow;
  const double per_way = 1.0 / (steel->rate * saturation);
  const double j = polarisation / saturation;
  const double fades = j * j - 2.0 * per_way * j + 2.0 * per_way * per_way;
  return steel->coercivity * (1.0 - steel->fading * fades);
}

static inline void look(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                        anhyst_plant_goal *goal)
{
  const anhyst_plant_duhem_steel *steel = &iron->steel.duhem;
  const anhyst_plant_duhem *now = &memory->own.duhem;
  anhyst_plant_duhem *then = &goal->own.duhem;
  const double saturation = steel->curve.sharp + steel->curve.slow;
  const double way = goal->at == memory->at ? memory->stride : goal->at - memory->at;
  const double up = way < 0.0 ? -1.0 : 1.0;
  double slope;
  double q;
  double share;
  then->polarisation = anhyst_plant_polarisation(&steel->curve, goal->at, &slope);
  share = then->polarisation / saturation;
  q = steel->rate * steel->coercivity * (1.0 - steel->fading * share * share);
  then->friction = up * parabola(steel, up * then->polarisation) +
                   (now->friction - up * parabola(steel, up * now->polarisation)) *
                       anhyst_exp_f64(-steel->rate * fabs(then->polarisation - now->polarisation));
  goal->field = goal->at + then->friction;
  goal->field_slope = 1.0 + (q - up * steel->rate * then->friction) * slope;
  goal->density = ANHYST_PLANT_MU0 * goal->field + then->polarisation;
  goal->density_slope = ANHYST_PLANT_MU0 * goal->field_slope + slope;
}

static void move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                 const anhyst_plant_goal *goal)
{
  (void)iron;
  memory->own.duhem = goal->own.duhem;
  memory->density = goal->density;
}

ANHYST_PLANT_FAMILY(duhem);
