/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the law of Jiles and Atherton with its exact step, for every format. The few operations
   in which the formats differ come before it: ../full_fixed.h, full_real.h. A path and the search
   along it are in full_path.h and full_search.h, the check of a block in full_block.h. */

/* The longest step along a tangent at all. */
#define MAX_SLIDE (UNIT / 64)

/* An interval in which the anhysteretic curve is a better guess than its middle, at least. */
#define MIN_CURVE_INTERVAL (UNIT / 64)

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

/* The magnetisation at the memory. A candidate HERE knows it, and one AHEAD that stays. */
static inline number start_magnetisation(const compensator *c, const path *along)
{
  number rise;
  if (c->stage == ANHYST_STAGE_HERE ||
      (c->stage == ANHYST_STAGE_AHEAD && c->next.of.full.direction == 0)) {
    return within_unit(c->next.of.full.m);
  }
  return magnetisation(along, along->y, odd_value(along->curve, along->x, &rise));
}

/* The direction of a mirror. */
static inline int16_t direction_of(mirror way) { return way < 0 ? -1 : 1; }

/* Sets out from the memory, where the magnetisation is m. A candidate HERE of the same direction
   knows the slopes. */
static void start(const compensator *c, path *along, mirror way, number m, answer *at)
{
  const candidate *known = &c->next;
  set_out(along, way);
  depart(along);
  at->x = along->x;
  at->y = along->y;
  at->p = along->p;
  at->m = turned(m, way);
  if (c->stage == ANHYST_STAGE_HERE && known->of.full.direction == direction_of(way)) {
    at->y_slope = rising(known->of.full.y_slope);
    at->m_slope = rising(known->of.full.m_slope);
  } else {
    find_start_slopes(along, at);
  }
}

/* The end of a solved path of the same start and direction. */
static void take_end(const path *along, const candidate *solved, mirror way, answer *at)
{
  at->x = above(turned(to_inner(solved->memory.full.x), way), along->x);
  at->y = above(turned(to_inner(solved->memory.full.y), way), along->y);
  at->p = above(turned(to_inner(solved->memory.full.p), way), along->p);
  at->m = within_unit(turned(solved->of.full.m, way));
  at->y_slope = rising(solved->of.full.y_slope);
  at->m_slope = rising(solved->of.full.m_slope);
}

/* Stores a place on a path as the candidate, in the direction that the path really had. If the play
   has not moved, it has not turned either. */
static void remember(compensator *c, const path *along, mirror way, const answer *at)
{
  const full_memory *from = &c->memory.full;
  full_memory *to = &c->next.memory.full;
  const int is_moved = at->p > along->p;
  to->x = to_memory(turned(at->x, way));
  to->y = to_memory(turned(at->y, way));
  to->p = to_memory(turned(at->p, way));
  to->turn = is_moved ? to_memory(turned(along->turn, way)) : from->turn;
  to->level = is_moved ? to_memory(turned(along->level, way)) : from->level;
  c->next.of.full.m = turned(at->m, way);
  c->next.of.full.y_slope = (candidate_slope)at->y_slope;
  c->next.of.full.m_slope = (candidate_slope)at->m_slope;
  c->next.of.full.direction = direction_of(way);
}

/* The iron stays where it is, exactly. */
static void stay(compensator *c, number m)
{
  c->next.memory = c->memory;
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

/* Lets the search stop as soon as the solution needs a current beyond its limit. */
static void stop_at_limit(const compensator *c, mirror way, search *find)
{
  const int16_t limit = way < 0 ? ANHYST_WORD_CURRENT_LOW : ANHYST_WORD_CURRENT_HIGH;
  const number most = current_limit(c->words, limit) - to_inner(c->arms.bias);
  find->stop_air = air_of_current(c->words[ANHYST_WORD_FULL_AIR], &c->arms);
  find->stop_iron = c->arms.flux_arm;
  find->stop = turned(most, way) + LIMIT_MARGIN;
}

/* The field that belongs to the flux of a compensator. If its current is beyond a limit, the
   largest field: the candidate is a place before it then. */
static number field_for_flux(compensator *c)
{
  path along;
  search find;
  answer at;
  prepare(&along, c->words, &c->memory.full);
  find.air = c->words[ANHYST_WORD_FULL_AIR];
  find.iron = QUARTER;
  at.x = along.x;
  at.m = start_magnetisation(c, &along);
  const number target = quarter_of(c->flux);
  const number residual = sum_at(find.air, find.iron, &at) - target;
  if (!is_residual(residual)) {
    stay(c, at.m);
    return c->memory.full.x;
  }
  const mirror way = mirror_of(residual > 0);
  find.target = turned(target, way);
  stop_at_limit(c, way, &find);
  start(c, &along, way, at.m, &at);
  const int is_found = rise(&along, &find, &at);
  remember(c, &along, way, &at);
  return is_found ? c->next.memory.full.x : to_memory(turned(MAX_FIELD, way));
}

/* Sets the target to what is missing from here on: air is rounded in fixed point. */
static inline void aim(search *find, const answer *at, number missing)
{
  find->target = within_current(sum_at(find->air, find->iron, at) + missing);
}

/* Finds the place of a current from the end of the path that was solved last, if the current is on
   this path. Returns 0 if it is not. */
static int find_from_end(compensator *c, path *along, search *find, number wanted)
{
  const candidate *solved = &c->next;
  const mirror way = mirror_of(solved->of.full.direction < 0);
  answer at;
  set_out(along, way);
  take_end(along, solved, way, &at);
  const number missing = turned(wanted, way) - current_at(c, at.x, at.m);
  aim(find, &at, missing);
  const number next = look(find, &at);
  if (next >= along->x && next <= MAX_FIELD && is_near(along, at.x, next)) {
    slide(along, next, &at);
    remember(c, along, way, &at);
    return 1;
  }
  depart(along);
  if (missing < 0) {
    const number from_start =
        turned(wanted, way) - current_at(c, along->x, start_magnetisation(c, along));
    if (!is_residual(from_start) || from_start < 0) {
      return 0;
    }
  }
  (void)rise(along, find, &at);
  remember(c, along, way, &at);
  return 1;
}

static number flux_for_current(compensator *c, number current)
{
  path along;
  search find;
  answer at;
  const number wanted = to_inner(current) - to_inner(c->arms.bias);
  prepare(&along, c->words, &c->memory.full);
  find.air = air_of_current(c->words[ANHYST_WORD_FULL_AIR], &c->arms);
  find.iron = c->arms.flux_arm;
  find.stop_air = 0;
  find.stop_iron = 0;
  find.stop = UNIT;
  if (c->stage != ANHYST_STAGE_AHEAD || c->next.of.full.direction == 0 ||
      !find_from_end(c, &along, &find, wanted)) {
    prepare(&along, c->words, &c->memory.full);
    at.m = start_magnetisation(c, &along);
    const number missing = wanted - current_at(c, along.x, at.m);
    if (is_residual(missing)) {
      const mirror way = mirror_of(missing < 0);
      start(c, &along, way, at.m, &at);
      aim(&find, &at, turned(missing, way));
      (void)rise(&along, &find, &at);
      remember(c, &along, way, &at);
    } else {
      stay(c, at.m);
    }
  }
  return to_outer(flux_at(c->words, to_inner(c->next.memory.full.x), c->next.of.full.m));
}
