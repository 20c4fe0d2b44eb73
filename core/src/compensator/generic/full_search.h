/* SPDX-License-Identifier: Apache-2.0 */
/* Template for full.h: the search along a path. The equations for a flux and for a current have the
   same form, air*x + iron*m = target. If the internal coupling of the iron exceeds the
   demagnetising effect of the gap, the coefficients of the flux and of the iron are negative. The
   air coefficient is always positive. The left side rises with x if the slope of m is below
   air/-iron everywhere. The check of a block requires this, so that the solution is unique. */

typedef struct {
  entry air;
  entry iron;
  number target;
} equation;

static inline number left_side(const equation *eq, number x, number m)
{
  return scaled(x, eq->air) + scaled(m, eq->iron);
}

/* Returns the slope of the left side of the equation, which is above 0. */
static inline number left_side_slope(const equation *eq, slope m_slope)
{
  const number found = weighted_slope(eq->air, eq->iron, m_slope);
  return found > MIN_SLOPE ? found : MIN_SLOPE;
}

/* Returns the Newton step that removes a residual: residual/slope with the opposite sign. */
static inline number newton_step(number residual, number steepness)
{
  return residual < 0 ? quotient(-residual, steepness) : -quotient(residual, steepness);
}

/* Returns an estimate of the solution for long steps, for which a tangent is inaccurate. Assumes
   that m rises like the anhysteretic curve from x on. */
static number guess_along_curve(const branch_path *path, const equation *eq, number x,
                                number residual)
{
  number rise;
  const number start = interpolate_odd(path->curve, x, &rise);
  if (eq->iron >= 0) { /* neglects the air term, which is small */
    const number level = start + newton_step(residual, eq->iron + MIN_SLOPE);
    return interpolate_odd(path->inverse, limit_to_one(level), &rise);
  }
  /* Starts with the field for the air term alone. Each iteration adds the iron up to the last
     field. The estimate never exceeds the solution. */
  number next = x;
  number remaining = residual;
  for (int16_t i = 0; i < CURVE_GUESS_STEPS; i++) {
    next = limit_to_one(x + newton_step(remaining, eq->air));
    const number risen = interpolate_odd(path->curve, next, &rise) - start;
    remaining = clamped(residual + scaled(risen, eq->iron), -MAX_RESIDUAL, MAX_RESIDUAL);
  }
  return next;
}

/* Interval of a path with rising field that contains the solution. */
typedef struct {
  number low;
  number high;
} interval;

/* Returns the first estimate on a path whose tangent leads beyond the range of constant y. At the
   end of this range, m is known without an evaluation, and shows on which side the solution is.
   Beyond the range, the magnetisation lags behind the anhysteretic curve. The lag grows
   exponentially to a final value that is proportional to kappa. */
static number guess_after_constant_y(const branch_path *path, const equation *eq, number end,
                                     interval *bracket)
{
  number rise;
  const number anhysteretic = interpolate_odd(path->curve, end, &rise);
  const number m = total_m(path->y, anhysteretic, path->reversible);
  const number residual = left_side(eq, end, m) - eq->target;
  if (residual >= 0) {
    bracket->high = end;
    return end;
  }
  bracket->low = end;
  const number guess = clamped(guess_along_curve(path, eq, end, residual), end, bracket->high);
  const number lag = path->kappa - times_fraction(path->kappa, path->reversible);
  const number lag_shift = multiply_by_decay(lag, decayed_fraction_after(path->decay, guess - end));
  return clamped(guess + lag_shift, end, bracket->high);
}

/* Returns the next estimate after a rejected Newton step, along the anhysteretic curve. Returns the
   midpoint if the interval is short, if the estimate is outside of the interval, or if the last
   step was also rejected, because the curve may make little progress. */
static number guess_after_rejection(const branch_path *path, const equation *eq,
                                    const interval *bracket, number x, number residual,
                                    int was_rejected)
{
  const number width = bracket->high - bracket->low;
  number next = bracket->low;
  if (width > MIN_CURVE_GUESS_INTERVAL && !was_rejected) {
    next = guess_along_curve(path, eq, x, residual);
  }
  return next > bracket->low && next < bracket->high ? next : bracket->low + half(width);
}

/* Solves from a point of a path whose y_start is known. At the start of the path, the residual must
   be negative. Newton steps stay in an interval that always contains the solution. A Newton step is
   accepted if it stays in the interval and is at least a quarter shorter than the last step, or if
   it is very short. Longer steps could oscillate across the two bends of the curve. The number of
   evaluations is limited. At least one evaluation is necessary, because tangents from the start
   would accumulate the errors of many short steps. The last step follows the tangents. If the
   solution exceeds the solution of the equation `limit`, solves `limit` instead and returns 1. */
/* NOLINTNEXTLINE(readability-function-cognitive-complexity): one search, its state in locals */
static int search_path(const branch_path *path, const equation *eq, const equation *limit,
                       path_point *found)
{
  const number start_field = path->y_start > path->p ? path->y_start : path->p;
  const number release_field = start_field + path->threshold;
  const equation *const target = eq;
  interval bracket = {path->x, MAX_FIELD};
  path_point point = *found;
  number residual = left_side(eq, point.x, point.m) - eq->target;
  number next = point.x + newton_step(residual, left_side_slope(eq, point.m_slope));
  number last_step = MAX_FIELD + MAX_FIELD;
  int was_rejected = 0;
  if (residual >= 0) {
    bracket.high = point.x;
  }
  if (release_field - point.x > PLAY_ROUNDING && next > release_field &&
      release_field < bracket.high) {
    next = guess_after_constant_y(path, eq, release_field, &bracket);
  } else if (next <= bracket.low || next >= bracket.high) {
    next = guess_after_rejection(path, eq, &bracket, point.x, residual, 0);
  } else {
    last_step = absolute(next - point.x);
  }
  for (int32_t evaluations_left = path->max_evaluations;; evaluations_left--) {
    point = evaluate_path(path, next);
    residual = left_side(eq, point.x, point.m) - eq->target;
    if (residual < 0 && limit != 0 && eq == target &&
        left_side(limit, point.x, point.m) > limit->target + CURRENT_LIMIT_MARGIN) {
      eq = limit;
      bracket.low = path->x;
      residual = left_side(eq, point.x, point.m) - eq->target;
    }
    const number steepness = left_side_slope(eq, point.m_slope);
    number to_bound; /* distance to the end of the interval */
    number step;
    if (residual < 0) {
      bracket.low = point.x;
      to_bound = bracket.high - point.x;
      step = quotient(-residual, steepness);
      next = point.x + (step < to_bound ? step : to_bound);
    } else {
      bracket.high = point.x;
      to_bound = point.x - bracket.low;
      step = quotient(residual, steepness);
      next = point.x - (step < to_bound ? step : to_bound);
    }
    if (evaluations_left <= 1 || is_tangent_accurate(path, point.x, next)) {
      break;
    }
    if (step > MIN_CHECKED_STEP && (step >= to_bound || step > last_step - half(half(last_step)))) {
      next = guess_after_rejection(path, eq, &bracket, point.x, residual, was_rejected);
      last_step = bracket.high - bracket.low;
      was_rejected = 1;
    } else {
      last_step = step;
      was_rejected = 0;
    }
  }
  follow_tangent(path, next, &point);
  *found = point;
  return eq != target;
}
