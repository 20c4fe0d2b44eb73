/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the search along a path, for full.h. A flux and a current are both one equation,
   air*x + iron*m = target. Iron that couples to itself more than the gap decouples it makes the
   flux arm, and so iron, negative. air stays above 0, and the sum rises with x as long as m is
   nowhere steeper than air/-iron, which the check of a block requires. So the solution is unique. */

/* air*x + iron*m = target along a rising path, and the interval that contains the solution. */
typedef struct {
  entry air;
  entry iron;
  number target;
  number low;
  number high;
  number residual; /* at the last evaluated place */
  entry stop_air;  /* the search stops where stop_air*x + stop_iron*m is beyond `stop` and ... */
  entry stop_iron;
  number stop; /* ... the solution is further on: it needs a current beyond its limit */
} search;

static inline number sum_at(entry air, entry iron, const answer *at)
{
  return scaled(at->x, air) + scaled(at->m, iron);
}

/* A residual over a slope, in the direction that removes the residual. */
static inline number step_against(number residual, number rise)
{
  return residual < 0 ? quotient(-residual, rise) : -quotient(residual, rise);
}

/* Narrows the interval by an evaluated place; returns where its tangent meets the target. */
static inline number look(search *find, const answer *at)
{
  const number steepness = slope_of_sum(find->air, find->iron, at->m_slope);
  find->residual = sum_at(find->air, find->iron, at) - find->target;
  if (find->residual < 0) {
    find->low = at->x;
  } else {
    find->high = at->x;
  }
  return at->x + step_against(find->residual, steepness > MIN_SLOPE ? steepness : MIN_SLOPE);
}

/* Returns where the path would meet its target if m rose like the anhysteretic curve: a guess for
   long steps, for which a tangent is wrong. */
static number follow_curve(const path *along, const search *find, number x)
{
  number rise;
  const number start = odd_value(along->curve, x, &rise);
  if (find->iron >= 0) { /* without the air, which counts little */
    const number level = start + step_against(find->residual, find->iron + MIN_SLOPE);
    return odd_value(along->inverse, within_unit(level), &rise);
  }
  /* Against the air: as far as the air alone would lead, then with the iron up to there, which never
     leads too far. */
  number next = x;
  number missing = find->residual;
  for (int16_t i = 0; i < CHORD_STEPS; i++) {
    next = within_unit(x + step_against(missing, find->air));
    const number risen = odd_value(along->curve, next, &rise) - start;
    missing = clamped(find->residual + scaled(risen, find->iron), -MAX_RESIDUAL, MAX_RESIDUAL);
  }
  return next;
}

/* Returns where to look first on a path that begins held, up to a known end. There m needs no
   evaluation of the path, and it shows on which side the solution is. The tangent at the start does
   not know the path beyond the end. */
static number leave_hold(const path *along, search *find, number end, number tangent)
{
  number rise;
  answer at;
  number first = tangent;
  at.x = end;
  at.m = magnetisation(along, along->y, odd_value(along->curve, end, &rise));
  find->residual = sum_at(find->air, find->iron, &at) - find->target;
  if (find->residual < 0) {
    find->low = end;
    first = follow_curve(along, find, end);
  } else {
    find->high = end;
  }
  return clamped(first, find->low, find->high);
}

/* Whether the tangents lead to a place: near, and not beyond where the play begins to pull y. */
static inline int is_near(const path *along, number x, number next)
{
  const number taken_up = along->p + along->play - PLAY_SLACK;
  return size_of(next - x) <= along->tangent_step && (x >= taken_up || next <= taken_up);
}

/* Whether a step remains inside the interval and is shorter by a quarter than the last one, since
   tangents can swing across the two bends of the curve; or is too short to matter. */
static inline int is_step_accepted(const search *find, number x, number next, number last_step)
{
  const number step = size_of(next - x);
  return step <= MIN_CHECKED_STEP || (next > find->low && next < find->high &&
                                      step <= last_step - half_of(half_of(last_step)));
}

/* Returns where to look after a Newton step that was not accepted: along the anhysteretic curve, or
   in the middle. With iron against the air the curve leads a little way at a time if the sum is
   almost flat; there it is the middle as soon as the last step was longer than the interval. */
static number find_next(const path *along, const search *find, number x, int16_t i,
                        number last_step)
{
  const number width = find->high - find->low;
  number next = find->low;
  if (width > MIN_CURVE_INTERVAL && (find->iron >= 0 || i < 2 || last_step < width)) {
    next = follow_curve(along, find, x);
  }
  if (next <= find->low || next >= find->high) {
    next = find->low + half_of(width);
  }
  return next;
}

/* Solves from a place on a path that has departed, at whose start the residual is negative. Makes
   Newton steps inside an interval that always contains the solution. The number of evaluations is
   bounded, and at least 1, since tangents at the start would add up errors of many short steps; the
   last step is taken along the tangents. Returns 0 if the search stopped before the solution. */
static int rise(const path *along, search *find, answer *at)
{
  const int16_t evaluations = (int16_t)along->words[ANHYST_WORD_FULL_ITERATIONS];
  const number moves = along->departure > along->p ? along->departure : along->p;
  const number freed = moves + along->play;
  number last_step = 4 * MAX_FIELD;
  find->low = along->x;
  find->high = MAX_FIELD;
  number next = look(find, at);
  for (int16_t i = 0; i < evaluations; i++) {
    const number x = at->x;
    if (i == 0 && freed - x > PLAY_SLACK && freed < find->high) {
      next = leave_hold(along, find, freed, next);
    } else if (is_step_accepted(find, x, next, last_step)) {
      next = clamped(next, find->low, find->high);
      last_step = size_of(next - x);
    } else {
      next = find_next(along, find, x, i, last_step);
      last_step = find->high - find->low;
    }
    evaluate(along, next, at);
    next = look(find, at);
    if (is_near(along, at->x, next)) {
      break;
    }
    if (find->residual < 0 && sum_at(find->stop_air, find->stop_iron, at) > find->stop) {
      return 0;
    }
  }
  slide(along, clamped(next, find->low, find->high), at);
  return 1;
}
