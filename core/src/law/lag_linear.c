/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with an anhysteretic curve that is linear within each step. */
#include <math.h>

#include "anhyst/numeric/elementary.h"

#include "lag.h"
#include "weights.h"

static int is_law_valid(const anhyst_operator_f64 *law)
{
  (void)law;
  return 1;
}

static double irreversible_m(anhyst_path_f64 *path, double p, double pull, double slope,
                             double *y_slope)
{
  const double y0 = path->from.y;
  const double travel = p - path->from.p;
  const double s = fabs(travel) / path->law->kappa;
  const double rise = pull - path->irreversible_limit;
  const double ahead = pull - y0;
  const double start = path->irreversible_limit - y0;
  if (path->sign * start >= 0.0) {
    const weights w = weights_at(s);
    *y_slope =
        path->sign / path->law->kappa * (start * (1.0 - w.e) + rise * w.g_slope) + slope * w.g;
    return y0 + start * w.e + rise * w.g;
  }
  const double s_after_crossing = s * ahead / rise;
  const weights w = weights_at(s_after_crossing);
  *y_slope = slope * w.g +
             ahead * w.g_slope * s_after_crossing * (1.0 / travel + slope / ahead - slope / rise);
  return y0 + ahead * w.g;
}

const anhyst_lag anhyst_lag_linear = {is_law_valid, anhyst_lag_max_slope, irreversible_m};
