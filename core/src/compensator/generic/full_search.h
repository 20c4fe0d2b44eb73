/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the search along a path, for full.h. A flux and a current are both one equation,
   air*x + iron*m = target. Iron that couples to itself more than the gap decouples it makes the
   flux arm, and so iron, negative. air stays above 0, and the sum rises with x as long as m is
   nowhere steeper than air/-iron, which the check of a block requires. So the solution is unique.
 */

/* air*x + iron*m = target. */
typedef struct {
  entry air;
  entry iron;
  number target;
} equation;

static inline number sum_at(const equation *of, number x, number m)
{
  return scaled(x, of->air) + scaled(m, of->iron);
}

/* The slope of a sum, above 0. */
static inline number sum_slope(const equation *of, slope m_slope)
{
  const number found = slope_of_sum(of->air, of->iron, m_slope);
  return found > MIN_SLOPE ? found : MIN_SLOPE;
}

/* A residual over a slope, in the direction that removes the residual. */
static inline number step_against(number residual, number steepness)
{
  return residual < 0 ? quotient(-residual, steepness) : -quotient(residual, steepness);
}

/* Returns where the path would meet its target from x on if m rose like the anhysteretic curve: a
   guess for long steps, for which a tangent is wrong. */
static number follow_curve(const path *along, const equation *of, number x, number residual)
{
  number rise;
  const number start = odd_value(along->curve, x, &rise);
  if (of->iron >= 0) { /* without the air, which counts little */
    const number level = start + step_against(residual, of->iron + MIN_SLOPE);
    return odd_value(along->inverse, within_unit(level), &rise);
  }
  /* Against the air: as far as the air alone would lead, then with the iron up to there, which
     never leads too far. */
  number next = x;
  number missing = residual;
  for (int16_t i = 0; i < CHORD_STEPS; i++) {
    next = within_unit(x + step_against(missing, of->air));
    const number risen = odd_value(along->curve, next, &rise) - start;
    missing = clamped(residual + scaled(risen, of->iron), -MAX_RESIDUAL, MAX_RESIDUAL);
  }
  return next;
}

/* The interval of a rising path that contains the solution. */
typedef struct {
  number low;
  number high;
} interval;

/* Returns where to look first on a path that begins held, if the tangent leads beyond the hold. At
   its end m needs no evaluation of the path, and it shows on which side the solution is. Beyond the
   end the path falls behind the curve, by the share of a lag of kappa that is forgotten. */
static number leave_hold(const path *along, const equation *of, number end, interval *within)
{
  number rise;
  const number anhysteretic = odd_value(along->curve, end, &rise);
  const number m = magnetisation(along->y, anhysteretic, along->reversible);
  const number residual = sum_at(of, end, m) - of->target;
  if (residual >= 0) {
    within->high = end;
    return end;
  }
  within->low = end;
  const number guess = clamped(follow_curve(along, of, end, residual), end, within->high);
  const number lag = along->kappa - part_of(along->kappa, along->reversible);
  const number behind = share_of(lag, forgotten_along(along->fades, guess - end));
  return clamped(guess + behind, end, within->high);
}

/* Returns where to look after a Newton step that was not accepted: along the anhysteretic curve.
   Looks in the middle if the interval is short, the curve leads out of it, or the last step was not
   accepted either: the curve may lead only a little way at a time. */
static number look_elsewhere(const path *along, const equation *of, const interval *within,
                             number x, number residual, int is_stuck)
{
  const number width = within->high - within->low;
  number next = within->low;
  if (width > MIN_CURVE_INTERVAL && !is_stuck) {
    next = follow_curve(along, of, x, residual);
  }
  return next > within->low && next < within->high ? next : within->low + half_of(width);
}

/* Solves from a place on a path that has departed, at whose start the residual is negative. Makes
   Newton steps inside an interval that always contains the solution. A step is accepted if it
   remains inside and is shorter by a quarter than the last one, since tangents can swing across the
   two bends of the curve, or if it is too short to matter. The number of evaluations is bounded,
   and at least 1, since tangents at the start would add up errors of many short steps; the last
   step is taken along the tangents. If the solution is beyond that of the equation `limit`, solves
   that one instead and returns 1. */
/* NOLINTNEXTLINE(readability-function-cognitive-complexity): one search, its state in locals */
static int rise(const path *along, const equation *of, const equation *limit, answer *found)
{
  const number moves = along->departure > along->p ? along->departure : along->p;
  const number freed = moves + along->play;
  const equation *const wanted = of;
  interval within = {along->x, MAX_FIELD};
  answer at = *found;
  number residual = sum_at(of, at.x, at.m) - of->target;
  number next = at.x + step_against(residual, sum_slope(of, at.m_slope));
  number last_step = MAX_FIELD + MAX_FIELD;
  int is_stuck = 0;
  if (residual >= 0) {
    within.high = at.x;
  }
  if (freed - at.x > PLAY_SLACK && next > freed && freed < within.high) {
    next = leave_hold(along, of, freed, &within);
  } else if (next <= within.low || next >= within.high) {
    next = look_elsewhere(along, of, &within, at.x, residual, 0);
  } else {
    last_step = absolute(next - at.x);
  }
  for (int32_t left = along->evaluations;; left--) {
    at = evaluate(along, next);
    residual = sum_at(of, at.x, at.m) - of->target;
    if (residual < 0 && limit != 0 && of == wanted &&
        sum_at(limit, at.x, at.m) > limit->target + LIMIT_MARGIN) {
      of = limit;
      within.low = along->x;
      residual = sum_at(of, at.x, at.m) - of->target;
    }
    const number steepness = sum_slope(of, at.m_slope);
    number room; /* to the end of the interval */
    number step;
    if (residual < 0) {
      within.low = at.x;
      room = within.high - at.x;
      step = quotient(-residual, steepness);
      next = at.x + (step < room ? step : room);
    } else {
      within.high = at.x;
      room = at.x - within.low;
      step = quotient(residual, steepness);
      next = at.x - (step < room ? step : room);
    }
    if (left <= 1 || is_near(along, at.x, next)) {
      break;
    }
    if (step > MIN_CHECKED_STEP &&
        (step >= room || step > last_step - half_of(half_of(last_step)))) {
      next = look_elsewhere(along, of, &within, at.x, residual, is_stuck);
      last_step = within.high - within.low;
      is_stuck = 1;
    } else {
      last_step = step;
      is_stuck = 0;
    }
  }
  slide(along, next, &at);
  *found = at;
  return of != wanted;
}
