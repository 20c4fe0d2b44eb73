/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law of 1986, integrated by classical Runge-Kutta sub-steps. */
#include <float.h>
#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"

#include "lag.h"

static int is_law_valid(const anhyst_operator_f64 *law)
{
  (void)law;
  return 1;
}

static double steepest_slope(const anhyst_operator_f64 *law)
{
  return law->eps > 0.0 ? 1.0 / (3.0 - law->eps) : 1.0 / 3.0;
}

static double irreversible_slope(const anhyst_path_f64 *path, double p, double y)
{
  double slope;
  const double drive = path->sign * (anhyst_langevin_f64(p, &slope) - y);
  const double q = drive > 0.0 ? drive / path->law->kappa : 0.0;
  const double eps = path->law->eps;
  return q * (1.0 - eps * slope) / (1.0 - eps * q);
}

/* Integrates by the classical Runge-Kutta method, from the point at which y starts to change. Full
   sub-steps come first, then the remainder, so that the result is a continuous function of the end.
   If a path is much longer than the decay length of the lag, only its end is integrated. This
   integration starts from the steady-state lag kappa*L'. */
static double integrate_lag(const anhyst_path_f64 *path, double p)
{
  const double eps = path->law->eps;
  const double slope_factor = 1.0 - eps / 3.0;
  /* The closer eps is to 3, the stiffer is the differential equation. */
  const double lag_step = path->law->kappa / 8.0 * (slope_factor < 1.0 ? slope_factor : 1.0);
  const double decay_length =
      40.0 * path->law->kappa * (eps < 0.0 ? slope_factor * slope_factor : 1.0 / slope_factor);
  double at = path->departure;
  double y = path->from.y;
  if (fabs(p - at) > decay_length) {
    double slope;
    at = p - path->sign * decay_length;
    y = anhyst_langevin_f64(at, &slope);
    y -= path->sign * path->law->kappa * slope;
  }
  if (lag_step <= 4.0 * DBL_EPSILON * fabs(p)) {
    /* At such a large field, a sub-step is below the rounding error of p, but L is linear. */
    double slope;
    const double anhysteretic = anhyst_langevin_f64(p, &slope);
    const double decay = anhyst_exp_f64(-fabs(p - at) / path->law->kappa);
    const double deviation = y - anhyst_langevin_f64(at, &slope);
    return anhysteretic + deviation * decay - path->sign * path->law->kappa * slope * (1.0 - decay);
  }
  int has_more_steps = 1;
  while (has_more_steps) {
    const double curve_step = (1.0 + fabs(at)) / 16.0;
    double h = path->sign * (lag_step < curve_step ? lag_step : curve_step);
    if (fabs(p - at) <= fabs(h)) {
      h = p - at;
      has_more_steps = 0;
    }
    const double half = 0.5 * h;
    const double k1 = irreversible_slope(path, at, y);
    const double k2 = irreversible_slope(path, at + half, y + half * k1);
    const double k3 = irreversible_slope(path, at + half, y + half * k2);
    const double k4 = irreversible_slope(path, at + h, y + h * k3);
    y += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
    at += h;
  }
  return y;
}

static double irreversible_m(anhyst_path_f64 *path, double p, double pull, double slope,
                             double *y_slope)
{
  (void)pull;
  (void)slope;
  if (!path->is_departure_known) {
    anhyst_path_find_y_start(path);
  }
  if (path->sign * (p - path->departure) <= 0.0) {
    return path->from.y;
  }
  const double y = integrate_lag(path, p);
  *y_slope = irreversible_slope(path, p, y);
  return y;
}

const anhyst_lag anhyst_lag_1986 = {is_law_valid, steepest_slope, irreversible_m};
