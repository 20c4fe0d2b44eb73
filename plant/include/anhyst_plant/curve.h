/* SPDX-License-Identifier: Apache-2.0 */
/* The anhysteretic curve of a steel:

     J = sharp*h/sqrt(h^2 + knee_sharp^2) + slow*2/pi*atan(h/knee_slow) */
#ifndef ANHYST_PLANT_CURVE_H
#define ANHYST_PLANT_CURVE_H

#include <math.h>

#include "anhyst/numeric/arctangent.h"

typedef struct {
  double sharp;      /* T */
  double knee_sharp; /* A/m */
  double slow;       /* T */
  double knee_slow;  /* A/m */
} anhyst_plant_curve;

/* Returns the polarisation at a field, T, and its derivative. Inline for speed. */
static inline double anhyst_plant_polarisation(const anhyst_plant_curve *curve, double h,
                                               double *slope)
{
  const double two_over_pi = 0.63661977236758134308;
  const double knee = curve->knee_sharp;
  const double inverse = 1.0 / sqrt(h * h + knee * knee);
  const double ratio = h / curve->knee_slow;
  const double slow = two_over_pi * curve->slow;
  *slope = curve->sharp * knee * knee * inverse * inverse * inverse +
           slow / (curve->knee_slow * (1.0 + ratio * ratio));
  return curve->sharp * h * inverse + slow * anhyst_arctangent(ratio);
}

#endif
