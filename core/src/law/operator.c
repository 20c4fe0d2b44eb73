/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/operator.h"

#include <math.h>

#include "anhyst/law/langevin.h"

#include "lag.h"

static const anhyst_lag *lag_method_of(const anhyst_operator_f64 *law)
{
  if (law->step == ANHYST_STEP_EXACT) {
    return &anhyst_lag_exact;
  }
  return law->step == ANHYST_STEP_LINEAR ? &anhyst_lag_linear : &anhyst_lag_1986;
}

double anhyst_lag_max_slope(const anhyst_operator_f64 *law)
{
  (void)law;
  return 1.0 / 3.0;
}

void anhyst_path_find_y_start(anhyst_path_f64 *path)
{
  const int is_constant_first = path->sign * (path->irreversible_limit - path->from.y) < 0.0;
  path->departure = is_constant_first ? anhyst_inverse_langevin_f64(path->from.y) : path->from.p;
  path->is_departure_known = 1;
}

anhyst_status anhyst_operator_check_f64(const anhyst_operator_f64 *law)
{
  const int is_law_valid = law->kappa >= ANHYST_KAPPA_MIN && law->kappa <= ANHYST_KAPPA_MAX &&
                           law->c >= 0.0 && law->c <= 1.0 && law->play >= 0.0 &&
                           law->play <= ANHYST_X_MAX && law->eps <= ANHYST_EPS_MAX &&
                           law->eps > -ANHYST_X_MAX;
  return is_law_valid && lag_method_of(law)->is_law_valid(law) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

anhyst_status anhyst_state_check_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state)
{
  const double tolerance = 1e-9;
  double slope;
  const double pull = anhyst_langevin_f64(state->p, &slope) - state->y;
  const int is_law_valid =
      fabs(pull) <= law->kappa / 3.0 + tolerance &&
      fabs(state->x - state->p) <= law->play + tolerance * (1.0 + fabs(state->x)) &&
      fabs(state->y) < 1.0 && fabs(state->x) <= ANHYST_X_MAX;
  return is_law_valid ? ANHYST_OK : ANHYST_BAD_STATE;
}

double anhyst_operator_steepest_f64(const anhyst_operator_f64 *law)
{
  return lag_method_of(law)->steepest_slope(law);
}

double anhyst_operator_m_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state)
{
  double slope;
  return (1.0 - law->c) * state->y + law->c * anhyst_langevin_f64(state->x, &slope);
}

void anhyst_path_begin_f64(anhyst_path_f64 *path, const anhyst_operator_f64 *law,
                           const anhyst_state_f64 *from, double sign, anhyst_answer_f64 *start)
{
  double slope;
  const double pull = anhyst_langevin_f64(from->p, &slope);
  path->law = law;
  path->from = *from;
  path->sign = sign;
  path->irreversible_limit = pull;
  path->is_departure_known = 0;

  double x_pull = pull;
  double drive = sign * (pull - from->y) / law->kappa;
  start->p_slope = 1.0;
  if (law->play > 0.0) {
    x_pull = anhyst_langevin_f64(from->x, &slope);
    if (sign * (from->x - from->p) < law->play) {
      start->p_slope = 0.0;
      drive = 0.0;
    }
  }
  start->state = *from;
  start->y_slope = drive > 0.0 ? drive : 0.0;
  start->m = (1.0 - law->c) * from->y + law->c * x_pull;
  start->m_slope = (1.0 - law->c) * start->y_slope + law->c * slope;
}

/* Returns the irreversible magnetisation at p, with pull = L(p). *y_slope is dy/dp. */
static double irreversible_at(anhyst_path_f64 *path, double p, double pull, double slope,
                              double *y_slope)
{
  *y_slope = 0.0;
  if (path->sign * (p - path->from.p) <= 0.0 || path->sign * (pull - path->from.y) <= 0.0) {
    return path->from.y; /* play within its threshold, or anhysteretic curve not crossed yet */
  }
  return lag_method_of(path->law)->irreversible_m(path, p, pull, slope, y_slope);
}

void anhyst_path_at_f64(anhyst_path_f64 *path, double x, anhyst_answer_f64 *answer)
{
  const anhyst_operator_f64 *law = path->law;
  double slope;
  const double pull = anhyst_langevin_f64(x, &slope);
  double p = x;
  double p_pull = pull;
  double p_pull_slope = slope;
  answer->p_slope = 1.0;
  if (law->play > 0.0) {
    p = x - path->sign * law->play;
    if (path->sign * (p - path->from.p) <= 0.0) {
      p = path->from.p;
      answer->p_slope = 0.0;
    }
    p_pull = anhyst_langevin_f64(p, &p_pull_slope);
  }
  double y_slope;
  const double y = irreversible_at(path, p, p_pull, p_pull_slope, &y_slope);
  answer->state.x = x;
  answer->state.y = y;
  answer->state.p = p;
  answer->m = (1.0 - law->c) * y + law->c * pull;
  answer->y_slope = y_slope;
  answer->m_slope = (1.0 - law->c) * y_slope + law->c * slope;
}
