/* SPDX-License-Identifier: Apache-2.0 */
/* The law of 1986, in classical Runge-Kutta sub-steps. */
#include <float.h>
#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"

#include "lag.h"

static int is_valid(const anhyst_operator_f64 *law)
{
  (void)law;
  return 1;
}

static double steepest(const anhyst_operator_f64 *law)
{
  return law->eps > 0.0 ? 1.0 / (3.0 - law->eps) : 1.0 / 3.0;
}

/* dy/dp at (p, y), moving with sign. */
static double slope_at(const anhyst_path_f64 *path, double p, double y)
{
  double slope;
  const double drive = path->sign * (anhyst_langevin_f64(p, &slope) - y);
  const double q = drive > 0.0 ? drive / path->law->kappa : 0.0;
  const double eps = path->law->eps;
  return q * (1.0 - eps * slope) / (1.0 - eps * q);
}

/* Classical Runge-Kutta from the departure; full sub-steps first, then the rest, so that the
   result is a continuous function of the end. Of a path much longer than the lag remembers only the
   end is followed, from the steady lag kappa*L'. */
static double march(const anhyst_path_f64 *path, double p)
{
  const double eps = path->law->eps;
  const double stretch = 1.0 - eps / 3.0;
  /* The closer eps comes to 3, the stiffer the lag. */
  const double eighth = path->law->kappa / 8.0 * (stretch < 1.0 ? stretch : 1.0);
  const double memory = 40.0 * path->law->kappa * (eps < 0.0 ? stretch * stretch : 1.0 / stretch);
  double at = path->departure;
  double y = path->from.y;
  if (fabs(p - at) > memory) {
    double slope;
    at = p - path->sign * memory;
    y = anhyst_langevin_f64(at, &slope);
    y -= path->sign * path->law->kappa * slope;
  }
  if (eighth <= 4.0 * DBL_EPSILON * fabs(p)) {
    /* So far out a sub-step is lost to rounding, for ever; but there L is straight. */
    double slope;
    const double steady = anhyst_langevin_f64(p, &slope);
    const double kept = anhyst_exp_f64(-fabs(p - at) / path->law->kappa);
    const double left = y - anhyst_langevin_f64(at, &slope);
    return steady + left * kept - path->sign * path->law->kappa * slope * (1.0 - kept);
  }
  int more = 1;
  while (more) {
    const double bend = (1.0 + fabs(at)) / 16.0;
    double h = path->sign * (eighth < bend ? eighth : bend);
    if (fabs(p - at) <= fabs(h)) {
      h = p - at;
      more = 0;
    }
    const double half = 0.5 * h;
    const double k1 = slope_at(path, at, y);
    const double k2 = slope_at(path, at + half, y + half * k1);
    const double k3 = slope_at(path, at + half, y + half * k2);
    const double k4 = slope_at(path, at + h, y + h * k3);
    y += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
    at += h;
  }
  return y;
}

static double carry(anhyst_path_f64 *path, double p, double pull, double slope, double *y_slope)
{
  (void)pull;
  (void)slope;
  if (!path->departure_known) {
    anhyst_path_depart(path);
  }
  if (path->sign * (p - path->departure) <= 0.0) {
    return path->from.y;
  }
  const double y = march(path, p);
  *y_slope = slope_at(path, p, y);
  return y;
}

const anhyst_lag anhyst_lag_1986 = {is_valid, steepest, carry};
