/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/sensitivity.h"

#include <math.h>

#include "anhyst/numeric/elementary.h"
#include "anhyst/law/langevin.h"

#include "weights.h"

/* Derivatives of one step with respect to its inputs, the same for all directions: y1_t = by_y*y0_t
   + by_p0*p0_t + by_p1*p1_t + by_kappa*kappa_t. */
typedef struct {
  double by_y, by_p0, by_p1, by_kappa;
  double sign;
  double p_slope;          /* dp1/dx1, 1 or 0 */
  double pull, pull_slope; /* L(x1), L'(x1) */
} partials;

/* Sets the derivatives of a step during which y is constant. */
static void set_constant_y(partials *d)
{
  d->by_y = 1.0;
  d->by_p0 = 0.0;
  d->by_p1 = 0.0;
  d->by_kappa = 0.0;
}

static void set_exact_partials(const anhyst_path_f64 *path, const anhyst_branch_slope_f64 *slope,
                               const anhyst_answer_f64 *end, partials *d)
{
  const double kappa = path->law->kappa;
  const double sign = path->sign;
  const double s = fabs(end->state.p - path->departure) / kappa;
  const double decay = anhyst_exp_f64(-s);
  const int is_constant_first = sign * (path->irreversible_limit - path->from.y) < 0.0;
  d->by_y = decay;
  /* If y starts to change on the anhysteretic curve, L = y: a shift of this point has no effect. */
  d->by_p0 =
      is_constant_first ? 0.0 : -decay * sign * (path->irreversible_limit - path->from.y) / kappa;
  d->by_p1 = end->y_slope;
  d->by_kappa = sign * (anhyst_branch_slope_at_f64(slope, sign * end->state.p) -
                        anhyst_branch_slope_at_f64(slope, sign * path->departure) * decay) +
                path->branch_distance * decay * s / kappa;
}

static void set_linear_partials(const anhyst_path_f64 *path, const anhyst_answer_f64 *end,
                                double y_slope, partials *d)
{
  const double kappa = path->law->kappa;
  const double travel = end->state.p - path->from.p;
  const double s = fabs(travel) / kappa;
  double p0_slope;
  double p1_slope;
  const double m0 = anhyst_langevin_f64(path->from.p, &p0_slope);
  const double m1 = anhyst_langevin_f64(end->state.p, &p1_slope);
  const double start = m0 - path->from.y;
  const double rise = m1 - m0;
  d->by_p1 = y_slope;
  if (path->sign * start >= 0.0) {
    const weights w = weights_at(s);
    const double by_s = start * (1.0 - w.e) + rise * w.g_slope;
    d->by_y = 1.0 - w.e;
    d->by_p0 = (w.e - w.g) * p0_slope - path->sign * by_s / kappa;
    d->by_kappa = -by_s * s / kappa;
    return;
  }
  const double ahead = m1 - path->from.y;
  const double s_after_crossing = s * ahead / rise;
  const weights w = weights_at(s_after_crossing);
  const double by_log_s = ahead * w.g_slope * s_after_crossing;
  d->by_y = 1.0 - w.g - w.g_slope * s_after_crossing;
  d->by_p0 = by_log_s * (p0_slope / rise - 1.0 / travel);
  d->by_kappa = -by_log_s / kappa;
}

static void step_partials(const anhyst_operator_f64 *law, const anhyst_branch_slope_f64 *slope,
                          const anhyst_state_f64 *from, const anhyst_state_f64 *to, partials *d)
{
  anhyst_path_f64 path;
  anhyst_answer_f64 start;
  anhyst_answer_f64 end;
  d->sign = to->x < from->x ? -1.0 : 1.0;
  anhyst_path_begin_f64(&path, law, from, d->sign, &start);
  anhyst_path_at_f64(&path, to->x, &end);
  d->pull = anhyst_langevin_f64(to->x, &d->pull_slope);
  d->p_slope = end.p_slope;
  if (!(fabs(end.y_slope) > 0.0)) {
    set_constant_y(d);
  } else if (law->step == ANHYST_STEP_EXACT) {
    set_exact_partials(&path, slope, &end, d);
  } else {
    set_linear_partials(&path, &end, end.y_slope, d);
  }
}

/* Advances the derivatives of the state in one direction, over a step to the given state. */
static void advance_tangent(const anhyst_operator_f64 *law, const partials *d,
                            const anhyst_state_f64 *to, double m, double omega, double omega_t,
                            double r_t, anhyst_tangent_f64 *t, double *m_t)
{
  /* First the derivatives of p1 and y1 at a fixed x1, then the contribution of x1. */
  const double p_fixed = d->p_slope > 0.0 ? -d->sign * t->play : t->state.p;
  const double y_fixed =
      d->by_y * t->state.y + d->by_p0 * t->state.p + d->by_p1 * p_fixed + d->by_kappa * t->kappa;
  const double y_slope = d->by_p1 * d->p_slope;
  const double m_fixed = (1.0 - law->c) * y_fixed + (d->pull - to->y) * t->c;
  const double m_slope = (1.0 - law->c) * y_slope + law->c * d->pull_slope;
  const double x_t = (r_t - omega_t * m - omega * m_fixed) / (1.0 + omega * m_slope);
  t->state.x = x_t;
  t->state.p = p_fixed + d->p_slope * x_t;
  t->state.y = y_fixed + y_slope * x_t;
  *m_t = m_fixed + m_slope * x_t;
}

anhyst_status anhyst_sensitivity_f64(const anhyst_operator_f64 *law,
                                     const anhyst_branch_slope_f64 *branch_slope,
                                     const anhyst_differentiated_drive_f64 *drive,
                                     anhyst_state_f64 *state, anhyst_tangent_f64 *tangents,
                                     double *x, double *m, double *x_t, double *m_t, size_t *index)
{
  const size_t count = drive->directions;
  if (law->step == ANHYST_STEP_JA1986 || (law->step == ANHYST_STEP_EXACT && branch_slope == 0)) {
    return ANHYST_BAD_PARAMETER;
  }
  for (size_t i = 0; i < drive->n; i++) {
    anhyst_candidate_f64 next;
    partials d;
    const anhyst_status status = anhyst_solve_f64(law, state, drive->omega[i], drive->r[i], &next);
    if (status != ANHYST_OK) {
      *index = i;
      return status;
    }
    step_partials(law, branch_slope, state, &next.state, &d);
    for (size_t j = 0; j < count; j++) {
      const size_t at = i * count + j;
      advance_tangent(law, &d, &next.state, next.m, drive->omega[i], drive->omega_t[at],
                      drive->r_t[at], &tangents[j], &m_t[at]);
      x_t[at] = tangents[j].state.x;
    }
    x[i] = next.state.x;
    m[i] = next.m;
    *state = next.state;
  }
  return ANHYST_OK;
}
