/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/solver.h"

#include <float.h>
#include <math.h>

#include "anhyst/law/langevin.h"

/* The equation along one path, and the interval known to hold its first solution. */
typedef struct {
  anhyst_path_f64 path;
  double omega, r;
  double before; /* residual has the sign of the start here, or it is the start */
  double beyond; /* residual has the other sign here */
  int evaluations;
} search;

static double residual(search *find, double x, anhyst_answer_f64 *at)
{
  find->evaluations++;
  anhyst_path_at_f64(&find->path, x, at);
  return x + find->omega * at->m - find->r;
}

/* What rounding alone leaves of the residual. */
static double rounding(const search *find, const anhyst_answer_f64 *at)
{
  return 4.0 * DBL_EPSILON * (fabs(at->state.x) + fabs(find->omega * at->m) + fabs(find->r));
}

static void accept(const search *find, const anhyst_answer_f64 *at, double step,
                   anhyst_candidate_f64 *candidate)
{
  candidate->state = at->state;
  candidate->state.x += step;
  candidate->state.y += step * at->y_slope;
  candidate->state.p += step * at->p_slope;
  candidate->m = at->m + step * at->m_slope;
  candidate->m_slope = at->m_slope;
  candidate->evaluations = find->evaluations;
}

/* Newton from x, kept inside the interval; halves it by the geometric mean of the distances from
   the start, since it may span many orders of magnitude. */
static anhyst_status polish(search *find, double x, anhyst_candidate_f64 *candidate)
{
  const double start = find->path.from.x;
  const double sign = find->path.sign;
  /* A last Newton step this short is as good taken along the tangent as evaluated again. */
  const double kappa = find->path.law->kappa;
  const double tangent = DBL_EPSILON * (8.0 + fabs(x)) * kappa / (1.0 + kappa);
  double longest = fabs(find->beyond - find->before);
  for (int i = 0; i < 200; i++) {
    anhyst_answer_f64 at;
    const double g = residual(find, x, &at);
    const double step = -g / (1.0 + find->omega * at.m_slope);
    const double width = fabs(find->beyond - find->before);
    if (fabs(g) <= rounding(find, &at) || width <= 2.0 * DBL_EPSILON * fabs(x)) {
      accept(find, &at, 0.0, candidate);
      return ANHYST_OK;
    }
    if (sign * g < 0.0) {
      find->before = x;
    } else {
      find->beyond = x;
    }
    const double next = x + step;
    const int inside = sign * (next - find->before) > 0.0 && sign * (find->beyond - next) > 0.0;
    if (inside && step * step <= tangent) {
      accept(find, &at, step, candidate);
      return ANHYST_OK;
    }
    if (inside && fabs(step) <= longest) {
      /* Steps must halve: Newton can swing to and fro across the two bends of the curve. */
      longest = 0.5 * fabs(step);
      x = next;
      continue;
    }
    longest = 0.5 * width;
    const double near = fabs(find->before - start);
    const double far = fabs(find->beyond - start);
    x = near > 0.0 && far > 4.0 * near ? start + sign * sqrt(near) * sqrt(far)
                                       : 0.5 * (find->before + find->beyond);
  }
  return ANHYST_NOT_CONVERGED;
}

/* Where the residual is largest (towards its root) between two places of rising and falling
   residual: a fold. Bisection on the slope. */
static double fold(search *find, double rising, double falling)
{
  anhyst_answer_f64 at;
  for (int i = 0; i < 40; i++) {
    const double middle = 0.5 * (rising + falling);
    const double g = residual(find, middle, &at);
    if (find->path.sign * g >= 0.0) {
      return middle;
    }
    if (1.0 + find->omega * at.m_slope > 0.0) {
      rising = middle;
    } else {
      falling = middle;
    }
  }
  return rising;
}

/* Walks from the start until the residual changes sign. omega < 0 and dm/dx >= 0, so the residual
   changes by no more than the way gone: a step of its size cannot pass a solution. Near a fold
   such steps creep, so a least step is kept, and a fold inside one is looked into. */
static anhyst_status walk(search *find, double d)
{
  const double sign = find->path.sign;
  const double least = 1.0 / 64.0;
  const double limit = fabs(d) + 2.0 * fabs(find->omega) + 1.0;
  double x = find->path.from.x;
  double gap = fabs(d);
  int was_rising = 1;
  while (fabs(x - find->path.from.x) <= limit) {
    anhyst_answer_f64 at;
    const double next = x + sign * (gap > least ? gap : least);
    if (sign * next > ANHYST_X_MAX) {
      /* No solution up to there; and further out a step could be lost to rounding, for ever. */
      return ANHYST_OUT_OF_RANGE;
    }
    const double g = sign * residual(find, next, &at);
    const int rising = 1.0 + find->omega * at.m_slope > 0.0;
    find->before = x;
    if (g >= 0.0) {
      find->beyond = next;
      return ANHYST_OK;
    }
    if (was_rising && !rising && gap < least) {
      const double top = fold(find, x, next);
      if (sign * residual(find, top, &at) >= 0.0) {
        find->beyond = top;
        return ANHYST_OK;
      }
    }
    was_rising = rising;
    gap = -g;
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
  search find;
  anhyst_answer_f64 start;
  find.omega = omega;
  find.r = r;
  find.evaluations = 1;
  const double m = anhyst_operator_m_f64(law, state);
  const double d = r - state->x - omega * m;
  if (!(fabs(d) < 4.0 * ANHYST_X_MAX * (1.0 + fabs(omega)))) {
    return ANHYST_OUT_OF_RANGE;
  }
  const double sign = d < 0.0 ? -1.0 : 1.0;
  anhyst_path_begin_f64(&find.path, law, state, sign, &start);
  if (fabs(d) <= rounding(&find, &start)) {
    accept(&find, &start, 0.0, candidate);
    return ANHYST_OK;
  }

  const double least_slope = 1.0 + omega * steepest;
  double guess;
  anhyst_status status = ANHYST_OK;
  if (least_slope > 1e-6) {
    const double one = state->x + d / least_slope;
    const double other = state->x + d;
    const int shrinks = omega > 0.0;
    /* The start itself is a safe near end; rounding could put the solution just before it. */
    find.before = state->x;
    find.beyond = (shrinks ? other : one) + sign * DBL_EPSILON * (8.0 * fabs(other) + 1e-30);
    guess = state->x + d / (1.0 + omega * start.m_slope);
    if (shrinks && sign * (guess - one) < 0.0) {
      guess = one;
    }
  } else {
    status = walk(&find, d);
    guess = 0.5 * (find.before + find.beyond);
  }
  if (status == ANHYST_OK) {
    status = polish(&find, guess, candidate);
  }
  if (status == ANHYST_OK && !(fabs(candidate->state.x) <= ANHYST_X_MAX)) {
    status = ANHYST_OUT_OF_RANGE;
  }
  return status;
}
