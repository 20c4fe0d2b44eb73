/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/solver.h"

#include <float.h>
#include <math.h>

#include "anhyst/law/langevin.h"

/* The equation along one path, and the interval that contains its first solution. */
typedef struct {
  anhyst_path_f64 path;
  double omega, r;
  double near; /* start, or a position whose residual has the start's sign */
  double far;  /* a position whose residual has the opposite sign */
  int evaluations;
} path_search;

static double evaluate_residual(path_search *search, double x, anhyst_answer_f64 *at)
{
  search->evaluations++;
  anhyst_path_at_f64(&search->path, x, at);
  return x + search->omega * at->m - search->r;
}

static double rounding_error(const path_search *search, const anhyst_answer_f64 *at)
{
  return 4.0 * DBL_EPSILON * (fabs(at->state.x) + fabs(search->omega * at->m) + fabs(search->r));
}

static void store_candidate(const path_search *search, const anhyst_answer_f64 *at, double step,
                            anhyst_candidate_f64 *candidate)
{
  candidate->state = at->state;
  candidate->state.x += step;
  candidate->state.y += step * at->y_slope;
  candidate->state.p += step * at->p_slope;
  candidate->m = at->m + step * at->m_slope;
  candidate->m_slope = at->m_slope;
  candidate->evaluations = search->evaluations;
}

/* Newton's method from x, limited to the interval. After a rejected step, divides the interval at
   the geometric mean of the distances from the start, which can differ by orders of magnitude. */
static anhyst_status solve_in_bracket(path_search *search, double x,
                                      anhyst_candidate_f64 *candidate)
{
  const double start = search->path.from.x;
  const double sign = search->path.sign;
  /* A final Newton step of this length along the tangent is as accurate as another evaluation. */
  const double kappa = search->path.law->kappa;
  const double tangent = DBL_EPSILON * (8.0 + fabs(x)) * kappa / (1.0 + kappa);
  double longest = fabs(search->far - search->near);
  for (int i = 0; i < 200; i++) {
    anhyst_answer_f64 at;
    const double g = evaluate_residual(search, x, &at);
    const double step = -g / (1.0 + search->omega * at.m_slope);
    const double width = fabs(search->far - search->near);
    if (fabs(g) <= rounding_error(search, &at) || width <= 2.0 * DBL_EPSILON * fabs(x)) {
      store_candidate(search, &at, 0.0, candidate);
      return ANHYST_OK;
    }
    if (sign * g < 0.0) {
      search->near = x;
    } else {
      search->far = x;
    }
    const double next = x + step;
    const int is_inside = sign * (next - search->near) > 0.0 && sign * (search->far - next) > 0.0;
    if (is_inside && step * step <= tangent) {
      store_candidate(search, &at, step, candidate);
      return ANHYST_OK;
    }
    if (is_inside && fabs(step) <= longest) {
      /* Steps must halve, because Newton's method can oscillate across the two bends of the curve.
       */
      longest = 0.5 * fabs(step);
      x = next;
      continue;
    }
    longest = 0.5 * width;
    const double near_distance = fabs(search->near - start);
    const double far_distance = fabs(search->far - start);
    x = near_distance > 0.0 && far_distance > 4.0 * near_distance
            ? start + sign * sqrt(near_distance) * sqrt(far_distance)
            : 0.5 * (search->near + search->far);
  }
  return ANHYST_NOT_CONVERGED;
}

/* Returns the position of the largest residual (a fold), between a position with rising residual
   and a position with falling residual. A bisection on the slope finds the fold. */
static double find_fold(path_search *search, double rising, double falling)
{
  anhyst_answer_f64 at;
  for (int i = 0; i < 40; i++) {
    const double middle = 0.5 * (rising + falling);
    const double g = evaluate_residual(search, middle, &at);
    if (search->path.sign * g >= 0.0) {
      return middle;
    }
    if (1.0 + search->omega * at.m_slope > 0.0) {
      rising = middle;
    } else {
      falling = middle;
    }
  }
  return rising;
}

/* Follows the path from its start until the residual changes sign. With omega < 0 and dm/dx >= 0,
   the residual changes by at most the distance. Therefore, a step of the size of the residual
   cannot pass a solution. Near a fold, where the residual is tiny, a minimum step is used, and a
   fold within the minimum step is searched for. */
static anhyst_status find_bracket(path_search *search, double d)
{
  const double sign = search->path.sign;
  const double min_step = 1.0 / 64.0;
  const double limit = fabs(d) + 2.0 * fabs(search->omega) + 1.0;
  double x = search->path.from.x;
  double residual_size = fabs(d);
  int was_rising = 1;
  while (fabs(x - search->path.from.x) <= limit) {
    anhyst_answer_f64 at;
    const double next = x + sign * (residual_size > min_step ? residual_size : min_step);
    if (sign * next > ANHYST_X_MAX) {
      /* No solution exists up to this field. Above this field, a step could be lost to rounding. */
      return ANHYST_OUT_OF_RANGE;
    }
    const double g = sign * evaluate_residual(search, next, &at);
    const int is_rising = 1.0 + search->omega * at.m_slope > 0.0;
    search->near = x;
    if (g >= 0.0) {
      search->far = next;
      return ANHYST_OK;
    }
    if (was_rising && !is_rising && residual_size < min_step) {
      const double maximum = find_fold(search, x, next);
      if (sign * evaluate_residual(search, maximum, &at) >= 0.0) {
        search->far = maximum;
        return ANHYST_OK;
      }
    }
    was_rising = is_rising;
    residual_size = -g;
    x = next;
  }
  return ANHYST_NOT_CONVERGED;
}

anhyst_status anhyst_solve_f64(const anhyst_operator_f64 *law, const anhyst_state_f64 *state,
                               double omega, double r, anhyst_candidate_f64 *candidate)
{
  const double steepest = anhyst_operator_steepest_f64(law);
  if (-omega * law->c > 3.0) {
    return ANHYST_REFUSED;
  }
  path_search search;
  anhyst_answer_f64 start;
  search.omega = omega;
  search.r = r;
  search.evaluations = 1;
  const double m = anhyst_operator_m_f64(law, state);
  const double d = r - state->x - omega * m;
  if (!(fabs(d) < 4.0 * ANHYST_X_MAX * (1.0 + fabs(omega)))) {
    return ANHYST_OUT_OF_RANGE;
  }
  const double sign = d < 0.0 ? -1.0 : 1.0;
  anhyst_path_begin_f64(&search.path, law, state, sign, &start);
  if (fabs(d) <= rounding_error(&search, &start)) {
    store_candidate(&search, &start, 0.0, candidate);
    return ANHYST_OK;
  }

  const double min_slope = 1.0 + omega * steepest;
  double guess;
  anhyst_status status = ANHYST_OK;
  if (min_slope > 1e-6) {
    const double end_steepest = state->x + d / min_slope;
    const double end_flat = state->x + d;
    const int is_omega_positive = omega > 0.0;
    /* Uses the start as a safe bound: rounding could move the solution to before a closer bound. */
    search.near = state->x;
    search.far = (is_omega_positive ? end_flat : end_steepest) +
                 sign * DBL_EPSILON * (8.0 * fabs(end_flat) + 1e-30);
    guess = state->x + d / (1.0 + omega * start.m_slope);
    if (is_omega_positive && sign * (guess - end_steepest) < 0.0) {
      guess = end_steepest;
    }
  } else {
    status = find_bracket(&search, d);
    guess = 0.5 * (search.near + search.far);
  }
  if (status == ANHYST_OK) {
    status = solve_in_bracket(&search, guess, candidate);
  }
  if (status == ANHYST_OK && !(fabs(candidate->state.x) <= ANHYST_X_MAX)) {
    status = ANHYST_OUT_OF_RANGE;
  }
  return status;
}
