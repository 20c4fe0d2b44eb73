/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the Jiles-Atherton law with its exact step, for every number format. The operations
   that depend on the format are included before: ../full_fixed.h, full_real.h. full_path.h contains
   a path, full_search.h the search along it, and full_block.h the check of a block. */

/* Longest Newton step along a tangent. */
#define MAX_EXTRAPOLATION_STEP (ONE / 64)

/* Shortest interval in which the anhysteretic curve gives a better estimate than the midpoint. */
#define MIN_CURVE_GUESS_INTERVAL (ONE / 16)

/* Shorter Newton steps are accepted without a check. The limit is about the table error, 6e-5. */
#define MIN_CHECKED_STEP (ONE / 16384)

/* Number of iterations of the estimate along the anhysteretic curve for a negative iron weight. */
#define CURVE_GUESS_STEPS 4

#define MAX_RESIDUAL (2 * MAX_FIELD)

/* Tolerance of a current beyond its limit: the rounding error of its coefficients, 6e-5. */
#define CURRENT_LIMIT_MARGIN (ONE / 16384)

#include "full_path.h"

#include "full_search.h"

#include "full_block.h"

static inline int16_t direction_sign(mirror_type mirror) { return mirror < 0 ? -1 : 1; }

/* Returns the stored state as a point without slopes, and the rise of its anhysteretic segment. */
static inline path_point point_of_state(const compensator *c, number *rise)
{
  const full_memory *from = &c->memory.full;
  path_point point = {
      limit_to_one(to_internal(from->x)), limit_to_one(to_internal(from->y)), 0, 0, 0, 0};
  point.m = total_m(point.y, interpolate_odd(curve_table(c->words), point.x, rise),
                    c->words[ANHYST_WORD_FULL_REVERSIBLE]);
  return point;
}

static inline void start_path(const compensator *c, branch_path *path, mirror_type mirror,
                              number rise, path_point *point)
{
  init_branch_path(path, c->words, &c->memory.full, mirror);
  find_y_start(path, c->words, &c->memory.full, mirror);
  point->x = path->x;
  point->m = mirrored(point->m, mirror);
  find_start_slopes(path, rise, point);
}

/* Stores a point of a path as the trial step, mirrored back if the field falls. Changes the last
   reversal only if the play has moved. */
static inline void store_step(compensator *c, const branch_path *path, mirror_type mirror,
                              const path_point *point)
{
  const full_memory *from = &c->memory.full;
  candidate *to = &c->next;
  to->memory.full.x = to_stored(mirrored(point->x, mirror));
  to->memory.full.y = to_stored(mirrored(point->y, mirror));
  to->memory.full.p = to_stored(mirrored(point->p, mirror));
  to->memory.full.reversal_play = from->reversal_play;
  to->memory.full.reversal_y = from->reversal_y;
  if (point->p > path->p && to_path_direction(from->reversal_play, mirror) >= path->p) {
    to->memory.full.reversal_play = from->p;
    to->memory.full.reversal_y = from->y;
  }
  to->of.full.m = mirrored(point->m, mirror);
  to->of.full.y_slope = (candidate_slope)point->y_slope;
  to->of.full.m_slope = (candidate_slope)point->m_slope;
  to->of.full.direction = direction_sign(mirror);
}

/* Stores a trial step that leaves the state unchanged. Only a damaged field is limited to -1..1. */
static void keep_state(compensator *c, number m)
{
  c->next.memory = c->memory;
  c->next.memory.full.x = to_stored(limit_to_one(to_internal(c->memory.full.x)));
  c->next.of.full.m = m;
  c->next.of.full.direction = 0;
}

static inline number flux_at(const entry *words, number x, number m)
{
  return m + scaled(x, words[ANHYST_WORD_FULL_AIR]) * 4;
}

/* Returns the current of a point without its bias: flux_arm*flux + field_arm*x. */
static inline number current_at(const compensator *c, number x, number m)
{
  return scaled(flux_at(c->words, x, m), c->arms.flux_arm) + scaled(x, c->arms.field_arm);
}

/* Returns the equation for a current. In fixed point, the weight of the field is rounded. */
static inline equation current_equation(const compensator *c, number target)
{
  const equation eq = {air_weight_of_current(c->words[ANHYST_WORD_FULL_AIR], &c->arms),
                       c->arms.flux_arm, saturate_target(target)};
  return eq;
}

/* Returns the field for the flux c->flux. If the current of this flux exceeds a limit, returns the
   largest field instead. The trial step is then the point whose current is at the limit. */
static number field_for_flux(compensator *c)
{
  number segment_rise;
  path_point point = point_of_state(c, &segment_rise);
  equation eq = {c->words[ANHYST_WORD_FULL_AIR], QUARTER_WEIGHT,
                 scaled(to_internal(c->flux), QUARTER_WEIGHT)};
  const number residual = left_side(&eq, point.x, point.m) - eq.target;
  if (!is_residual(residual)) {
    keep_state(c, point.m);
    return c->next.memory.full.x;
  }
  const int is_falling = residual > 0;
  const mirror_type mirror = mirror_sign(is_falling);
  const number limit =
      current_limit(c->words, is_falling ? ANHYST_WORD_CURRENT_LOW : ANHYST_WORD_CURRENT_HIGH) -
      to_internal(c->arms.bias);
  if (mirrored(limit - current_at(c, point.x, point.m), mirror) <= RESIDUAL_DEADBAND) {
    keep_state(c, point.m);
    return to_stored(mirrored(MAX_FIELD, mirror));
  }
  branch_path path;
  const equation limit_equation = current_equation(c, mirrored(limit, mirror));
  eq.target = mirrored(eq.target, mirror);
  start_path(c, &path, mirror, segment_rise, &point);
  const int is_limited = search_path(&path, &eq, &limit_equation, &point);
  store_step(c, &path, mirror, &point);
  return is_limited ? to_stored(mirrored(MAX_FIELD, mirror)) : c->next.memory.full.x;
}

/* Returns the equation for a current that exceeds the current of a point by `residual`. */
static inline equation equation_for_residual(const compensator *c, const path_point *point,
                                             number residual)
{
  equation eq = current_equation(c, 0);
  eq.target = saturate_target(left_side(&eq, point->x, point->m) + residual);
  return eq;
}

/* Solves for a current from the end of the last solved path. Returns 0 if there is no solution. */
static int solve_from_last_step(compensator *c, number target)
{
  const candidate *end = &c->next;
  const mirror_type mirror = mirror_sign(end->of.full.direction < 0);
  branch_path path;
  path_point point;
  init_branch_path(&path, c->words, &c->memory.full, mirror);
  point.x = limit_from_below(mirrored(to_internal(end->memory.full.x), mirror), path.x);
  point.y = mirrored(to_internal(end->memory.full.y), mirror);
  point.p = path.p;
  point.m = limit_to_one(mirrored(end->of.full.m, mirror));
  point.y_slope = limit_slope(end->of.full.y_slope);
  point.m_slope = limit_slope(end->of.full.m_slope);
  const equation eq = current_equation(c, 0);
  const number residual = mirrored(target, mirror) - current_at(c, point.x, point.m);
  const number next = point.x + newton_step(-residual, left_side_slope(&eq, point.m_slope));
  if (next >= path.x && next <= MAX_FIELD && is_tangent_accurate(&path, point.x, next)) {
    follow_tangent(&path, next, &point);
    store_step(c, &path, mirror, &point);
    return 1;
  }
  number segment_rise;
  const path_point from = point_of_state(c, &segment_rise);
  if (residual < 0 &&
      mirrored(target - current_at(c, from.x, from.m), mirror) <= RESIDUAL_DEADBAND) {
    return 0;
  }
  find_y_start(&path, c->words, &c->memory.full, mirror);
  const equation remaining_equation = equation_for_residual(c, &point, residual);
  (void)search_path(&path, &remaining_equation, 0, &point);
  store_step(c, &path, mirror, &point);
  return 1;
}

static number flux_for_current(compensator *c, number current)
{
  const number target = to_internal(current) - to_internal(c->arms.bias);
  if (c->stage != ANHYST_STAGE_AHEAD || c->next.of.full.direction == 0 ||
      !solve_from_last_step(c, target)) {
    number segment_rise;
    path_point point = point_of_state(c, &segment_rise);
    const number residual = target - current_at(c, point.x, point.m);
    if (is_residual(residual)) {
      const mirror_type mirror = mirror_sign(residual < 0);
      branch_path path;
      start_path(c, &path, mirror, segment_rise, &point);
      const equation eq = equation_for_residual(c, &point, mirrored(residual, mirror));
      (void)search_path(&path, &eq, 0, &point);
      store_step(c, &path, mirror, &point);
    } else {
      keep_state(c, point.m);
    }
  }
  return to_external(flux_at(c->words, to_internal(c->next.memory.full.x), c->next.of.full.m));
}
