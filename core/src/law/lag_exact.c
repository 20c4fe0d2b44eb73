/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law, exact for any step length. The irreversible magnetisation y is the
   steady-state branch plus a deviation, which decays exponentially from the start of its change. */
#include <math.h>

#include "anhyst/numeric/elementary.h"

#include "lag.h"

static int is_law_valid(const anhyst_operator_f64 *law)
{
  return law->branch != 0 && !(law->branch->kappa < law->kappa) &&
         !(law->branch->kappa > law->kappa);
}

static double irreversible_m(anhyst_path_f64 *path, double p, double pull, double slope,
                             double *y_slope)
{
  const anhyst_operator_f64 *law = path->law;
  (void)slope;
  if (!path->is_departure_known) {
    anhyst_path_find_y_start(path);
    path->branch_distance =
        path->from.y - path->sign * anhyst_branch_at_f64(law->branch, path->sign * path->departure);
  }
  if (path->sign * (p - path->departure) <= 0.0) {
    return path->from.y;
  }
  const double decay = anhyst_exp_f64(-fabs(p - path->departure) / law->kappa);
  const double y = path->sign * anhyst_branch_at_f64(law->branch, path->sign * p) +
                   path->branch_distance * decay;
  const double drive = path->sign * (pull - y);
  *y_slope = drive > 0.0 ? drive / law->kappa : 0.0;
  return y;
}

const anhyst_lag anhyst_lag_exact = {is_law_valid, anhyst_lag_max_slope, irreversible_m};
