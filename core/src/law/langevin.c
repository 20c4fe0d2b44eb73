/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/langevin.h"

#include <float.h>
#include <math.h>

#include "anhyst/numeric/elementary.h"

/* Returns L(z)/z from t = z^2: the continued fraction 1/(3 + t/(5 + t/(7 + ...))) as a quotient. */
static double langevin_per_z(double t)
{
  const double top = 4583103525.0 + t * (349188840.0 + t * (6891885.0 + t * (42900.0 + t * 65.0)));
  const double bottom =
      13749310575.0 + t * (1964187225.0 + t * (64324260.0 + t * (675675.0 + t * (2145.0 + t))));
  return top / bottom;
}

double anhyst_langevin_f64(double z, double *slope)
{
  const double size = fabs(z);
  if (size < 1.5) {
    const double per_z = langevin_per_z(z * z);
    const double value = z * per_z;
    *slope = 1.0 - value * value - 2.0 * per_z;
    return value;
  }
  if (size > 22.0) { /* coth is 1 to the last digit */
    const double per_size = 1.0 / size;
    *slope = per_size * per_size;
    return z < 0.0 ? per_size - 1.0 : 1.0 - per_size;
  }
  const double e = anhyst_exp_f64(-2.0 * size);
  const double inverse = 1.0 / (size * (1.0 - e));
  const double per_size = inverse * (1.0 - e);
  const double per_rest = inverse * size;
  const double value = 1.0 - per_size + 2.0 * e * per_rest;
  *slope = per_size * per_size - 4.0 * e * per_rest * per_rest;
  return z < 0.0 ? -value : value;
}

double anhyst_inverse_langevin_f64(double y)
{
  double z = y * (3.0 - y * y) / (1.0 - y * y);
  for (int i = 0; i < 8; i++) {
    double slope;
    const double error = anhyst_langevin_f64(z, &slope) - y;
    const double step = error / slope;
    z -= step;
    if (fabs(step) <= 4.0 * DBL_EPSILON * fabs(z)) {
      break;
    }
  }
  return z;
}
