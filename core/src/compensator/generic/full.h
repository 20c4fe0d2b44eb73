/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the law of Jiles and Atherton with its exact step, for every format. The few operations
   in which the formats differ come before it: ../full_fixed.h, full_real.h. A path and the search
   along it are in full_path.h and full_search.h, the check of a block in full_block.h. */

/* The longest step along a tangent at all. */
#define MAX_SLIDE (UNIT / 64)

/* An interval in which the anhysteretic curve is a better guess than its middle, at least. */
#define MIN_CURVE_INTERVAL (UNIT / 16)

/* A shorter step is accepted without a check; about the uncertainty of the tables, 6e-5. */
#define MIN_CHECKED_STEP (UNIT / 16384)

/* Steps of the guess that follows the anhysteretic curve against the air. */
#define CHORD_STEPS 4

/* The largest residual of a search. */
#define MAX_RESIDUAL (2 * MAX_FIELD)

/* A current is beyond its limit if it is so by more than the rounding of its arms, 6e-5. */
#define LIMIT_MARGIN (UNIT / 16384)

#include "full_path.h"

#include "full_search.h"

#include "full_block.h"

/* The direction of a mirror. */
static inline int16_t direction_of(mirror way) { return way < 0 ? -1 : 1; }

/* The place of the memory, in no direction; *rise is that of the anhysteretic curve there. */
static inline answer at_memory(const compensator *c, number *rise)
{
  const full_memory *from = &c->memory.full;
  answer at = {within_unit(to_inner(from->x)), within_unit(to_inner(from->y)), 0, 0, 0, 0};
  at.m = magnetisation(at.y, odd_value(curve_of(c->words), at.x, rise),
                       c->words[ANHYST_WORD_FULL_REVERSIBLE]);
  return at;
}

/* Sets out from the memory. */
static inline void start(const compensator *c, path *along, mirror way, number rise, answer *at)
{
  begin(along, c->words, &c->memory.full, way);
  depart(along, c->words, &c->memory.full, way);
  at->x = along->x;
  at->m = turned(at->m, way);
  find_start_slopes(along, rise, at);
}

/* Stores a place on a path as the candidate, in the direction that the path really had. If the play
   has not moved, it has not turned either. */
static inline void remember(compensator *c, const path *along, mirror way, const answer *at)
{
  const full_memory *from = &c->memory.full;
  candidate *to = &c->next;
  to->memory.full.x = to_memory(turned(at->x, way));
  to->memory.full.y = to_memory(turned(at->y, way));
  to->memory.full.p = to_memory(turned(at->p, way));
  to->memory.full.turn = from->turn;
  to->memory.full.level = from->level;
  if (at->p > along->p && on_path(from->turn, way) >= along->p) {
    to->memory.full.turn = from->p;
    to->memory.full.level = from->y;
  }
  to->of.full.m = turned(at->m, way);
  to->of.full.y_slope = (candidate_slope)at->y_slope;
  to->of.full.m_slope = (candidate_slope)at->m_slope;
  to->of.full.direction = direction_of(way);
}

/* The iron stays where it is, exactly, unless the memory was damaged. */
static void stay(compensator *c, number m)
{
  c->next.memory = c->memory;
  c->next.memory.full.x = to_memory(within_unit(to_inner(c->memory.full.x)));
  c->next.of.full.m = m;
  c->next.of.full.direction = 0;
}

/* h*x + m at a place: the flux. */
static inline number flux_at(const entry *words, number x, number m)
{
  return m + scaled(x, words[ANHYST_WORD_FULL_AIR]) * 4;
}

/* flux_arm*flux + field_arm*x at a place: the current without its bias. */
static inline number current_at(const compensator *c, number x, number m)
{
  return scaled(flux_at(c->words, x, m), c->arms.flux_arm) + scaled(x, c->arms.field_arm);
}

/* The equation of a current; its air is rounded in fixed point. */
static inline equation of_current(const compensator *c, number target)
{
  const equation of = {air_of_current(c->words[ANHYST_WORD_FULL_AIR], &c->arms), c->arms.flux_arm,
                       bounded(target)};
  return of;
}

/* Returns the field that belongs to the flux of a compensator. If its current is beyond a limit,
   returns the largest field instead, and the candidate is where the current reaches the limit. */
static number field_for_flux(compensator *c)
{
  number segment_rise;
  answer at = at_memory(c, &segment_rise);
  equation of = {c->words[ANHYST_WORD_FULL_AIR], QUARTER, scaled(to_inner(c->flux), QUARTER)};
  const number residual = sum_at(&of, at.x, at.m) - of.target;
  if (!is_residual(residual)) {
    stay(c, at.m);
    return c->next.memory.full.x;
  }
  const int is_falling = residual > 0;
  const mirror way = mirror_of(is_falling);
  const number limit =
      current_limit(c->words, is_falling ? ANHYST_WORD_CURRENT_LOW : ANHYST_WORD_CURRENT_HIGH) -
      to_inner(c->arms.bias);
  if (turned(limit - current_at(c, at.x, at.m), way) <= RESIDUAL_DEADBAND) {
    stay(c, at.m);
    return to_memory(turned(MAX_FIELD, way));
  }
  path along;
  const equation of_limit = of_current(c, turned(limit, way));
  of.target = turned(of.target, way);
  start(c, &along, way, segment_rise, &at);
  const int is_limited = rise(&along, &of, &of_limit, &at);
  remember(c, &along, way, &at);
  return is_limited ? to_memory(turned(MAX_FIELD, way)) : c->next.memory.full.x;
}

/* The equation of a current of which this much is missing at a place. */
static inline equation aim(const compensator *c, const answer *at, number missing)
{
  equation of = of_current(c, 0);
  of.target = bounded(sum_at(&of, at->x, at->m) + missing);
  return of;
}

/* Finds the place of a current from the end of the path that was solved last. Returns 0 if the
   current is not on this path. */
static int find_from_end(compensator *c, number wanted)
{
  const candidate *end = &c->next;
  const mirror way = mirror_of(end->of.full.direction < 0);
  path along;
  answer at;
  begin(&along, c->words, &c->memory.full, way);
  at.x = above(turned(to_inner(end->memory.full.x), way), along.x);
  at.y = turned(to_inner(end->memory.full.y), way);
  at.p = along.p;
  at.m = within_unit(turned(end->of.full.m, way));
  at.y_slope = rising(end->of.full.y_slope);
  at.m_slope = rising(end->of.full.m_slope);
  const equation of = of_current(c, 0);
  const number missing = turned(wanted, way) - current_at(c, at.x, at.m);
  const number next = at.x + step_against(-missing, sum_slope(&of, at.m_slope));
  if (next >= along.x && next <= MAX_FIELD && is_near(&along, at.x, next)) {
    slide(&along, next, &at);
    remember(c, &along, way, &at);
    return 1;
  }
  number segment_rise;
  const answer from = at_memory(c, &segment_rise);
  if (missing < 0 && turned(wanted - current_at(c, from.x, from.m), way) <= RESIDUAL_DEADBAND) {
    return 0;
  }
  depart(&along, c->words, &c->memory.full, way);
  const equation of_rest = aim(c, &at, missing);
  (void)rise(&along, &of_rest, 0, &at);
  remember(c, &along, way, &at);
  return 1;
}

/* Returns the flux to which a current leads. */
static number flux_for_current(compensator *c, number current)
{
  const number wanted = to_inner(current) - to_inner(c->arms.bias);
  if (c->stage != ANHYST_STAGE_AHEAD || c->next.of.full.direction == 0 ||
      !find_from_end(c, wanted)) {
    number segment_rise;
    answer at = at_memory(c, &segment_rise);
    const number missing = wanted - current_at(c, at.x, at.m);
    if (is_residual(missing)) {
      const mirror way = mirror_of(missing < 0);
      path along;
      start(c, &along, way, segment_rise, &at);
      const equation of = aim(c, &at, turned(missing, way));
      (void)rise(&along, &of, 0, &at);
      remember(c, &along, way, &at);
    } else {
      stay(c, at.m);
    }
  }
  return to_outer(flux_at(c->words, to_inner(c->next.memory.full.x), c->next.of.full.m));
}
