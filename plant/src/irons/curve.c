/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/curve.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"

#define TWO_OVER_PI 0.63661977236758134308

double anhyst_plant_polarisation(const anhyst_plant_curve *curve, double h, double *slope)
{
  const double knee = curve->knee_sharp;
  const double inverse = 1.0 / sqrt(h * h + knee * knee);
  const double ratio = h / curve->knee_slow;
  const double slow = TWO_OVER_PI * curve->slow;
  *slope = curve->sharp * knee * knee * inverse * inverse * inverse +
           slow / (curve->knee_slow * (1.0 + ratio * ratio));
  return curve->sharp * h * inverse + slow * anhyst_atan_f64(ratio);
}
