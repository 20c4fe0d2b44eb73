/* SPDX-License-Identifier: Apache-2.0 */
/* The law of cells: plays in the effective field, each with a curve of its own, in fixed point.

   Cell i keeps its play p within r of the field x and gives f(p); m is the sum. Along a rising path
   those that move are the first ones, all with p = x - r, and their sum is a row of a table over x;
   the others rest:

     m = T(x) + C,   T of the cells that move, C of those that rest.

   The next cell joins where x reaches p + r. Everything happens on a path that rises: a falling
   one is mirrored. Rows are straight between their entries, so that what is solved for,

     flux_arm*(h*x + m) + field_arm*x = target,

   is solved in closed form on the segment where it lies. What a cell rests with was once counted
   from the rows, and is taken off again as exactly that number: C does not drift, however long one
   goes on. The solution is rounded against the direction of the path, by less than 2^-14 of a
   segment, so that a target that stays the same never turns the path. */
#include "cells_path.h"

/* A residual that is nothing but rounding: the iron stays where it is. */
#define STILL 4

/* What is solved for, over 4. */
typedef struct {
  int16_t air;
  int16_t flux_arm;
  int16_t field_arm;
  int32_t target; /* in the direction of the path */
} equation;

/* The left side at a place of the law, |x| <= 1. */
static int32_t left_side(const equation *solve, int32_t x, int32_t m)
{
  const int32_t flux = (m >> 2) + anhyst_scale(x, solve->air);
  return anhyst_scale(flux, solve->flux_arm) + (anhyst_scale(x, solve->field_arm) >> 2);
}

/* The same at the node of a row, 0 .. 2^bits. */
static int32_t at_node(const path *along, const equation *solve, int16_t node)
{
  const int16_t *row = along->rows + (along->active - 1) * along->stride;
  const int32_t x = (int32_t)(((uint32_t)node << (31U - along->bits)) - (uint32_t)ONE);
  return left_side(solve, x, (int32_t)row[node] * 32768 + along->rest);
}

/* The segment of a row that holds x. */
static int16_t segment_of(const path *along, int32_t x)
{
  return (int16_t)((x + ONE) >> (31U - along->bits));
}

/* n/d as a q15, rounded down by up to two units; 0 <= n <= d, 0 < d. */
static int32_t part_of(int32_t n, int32_t d)
{
  const uint16_t up = anhyst_headroom(d);
  const int32_t top = (int32_t)((uint32_t)n << up);
  const int32_t bottom = ((int32_t)((uint32_t)d << up) >> 15) + 1;
  return top / bottom;
}

/* The last segment of first..end at the beginning of which the target is not reached, or first. A
   tick leads a segment or two further, a jump anywhere: steps double, then halve. */
static int16_t segment_with_target(const path *along, const equation *solve, int16_t first,
                                   int16_t end)
{
  int16_t step = 1;
  while (first + step <= end && at_node(along, solve, (int16_t)(first + step)) < solve->target) {
    first = (int16_t)(first + step);
    step = (int16_t)(2 * step);
  }
  end = first + step - 1 < end ? (int16_t)(first + step - 1) : end;
  while (first < end) {
    const int16_t middle = (int16_t)((first + end + 1) / 2);
    if (at_node(along, solve, middle) < solve->target) {
      first = middle;
    } else {
      end = (int16_t)(middle - 1);
    }
  }
  return first;
}

/* Where the target is met on the straight line of a segment, between its ends. */
static int32_t meet(const path *along, const equation *solve, int16_t segment)
{
  const int32_t begin = at_node(along, solve, segment);
  const int32_t rise = at_node(along, solve, (int16_t)(segment + 1)) - begin;
  const int32_t way = solve->target - begin;
  const uint16_t fine = (uint16_t)(16U - along->bits);
  int32_t part = 0;
  if (way > 0 && rise > 0) {
    part = way < rise ? part_of(way, rise) : 32767;
  }
  const int32_t fraction = (int32_t)(((uint32_t)segment << 15) + (uint32_t)part);
  return (int32_t)(((uint32_t)fraction << fine) - (uint32_t)ONE);
}

/* Takes the next cell along: it moves from here on. */
static void join(path *along, int32_t play)
{
  const int16_t cell = along->active;
  const int32_t risen = ((uint32_t)along->frozen >> (uint16_t)cell) & 1U ? 0 : -1;
  int32_t counted;
  if (risen == along->falling) {
    counted = alone(along, cell, play);
  } else {
    counted = -alone(along, cell, ~play);
  }
  along->rest = inside(along->rest - counted);
  along->active = (int16_t)(cell + 1);
}

/* Lets the cells join that do so before the target is reached; gives where the last one did and
   where the next one would, between which the solution lies. */
static int32_t gather(path *along, const equation *solve, int32_t *next)
{
  int32_t low = along->x;
  *next = ONE - 1;
  while (along->active <= along->cells) {
    const int32_t play = at_rest(along, along->active);
    const int32_t joins = play + width(along, along->active);
    const int32_t here = joins > low ? joins : low;
    const int32_t m = moving(along, along->active, here) + along->rest;
    if (left_side(solve, here, m) >= solve->target) {
      *next = here;
      break;
    }
    join(along, play);
    low = here;
  }
  if (along->active > along->cells) {
    along->rest = 0; /* none rests */
  }
  return low;
}

/* Leaves a path for the opposite one: all but cell 0 rest. */
static void turn(path *along, equation *solve)
{
  const int32_t left = moving(along, along->active, along->x) - moving(along, 1, along->x);
  const uint32_t moved = (((uint32_t)1 << (uint16_t)along->active) - 1U);
  const uint32_t frozen = (uint32_t)along->frozen & ~moved;
  along->frozen = (int32_t)(along->falling == 0 ? frozen | moved : frozen);
  along->rest = ~inside(along->rest + left);
  along->x = ~along->x;
  along->falling = ~along->falling;
  along->moved = along->active;
  along->active = 1;
  solve->target = ~solve->target;
}

/* Where a path has led. */
static void remember(const path *along, int32_t x, int32_t low, anhyst_memory *to)
{
  to->x = turned(x, along->falling);
  to->y = turned(along->rest, along->falling);
  to->p = along->falling == 0 ? along->active : -along->active;
  to->turn = along->frozen;
  to->level = low;
}

/* Solves from a memory on; gives m at the end, in its direction. */
static int32_t advance(path *along, equation *solve, anhyst_candidate *to)
{
  int32_t low = along->x;
  solve->target = turned(solve->target, along->falling);
  int32_t m = moving(along, along->active, along->x) + along->rest;
  const int32_t missing = solve->target - left_side(solve, along->x, m);
  to->way = 0;
  to->m = ONE - 1;
  if (missing > STILL || missing < -STILL) {
    if (missing < 0) {
      turn(along, solve);
    }
    low = gather(along, solve, &to->m);
    const int16_t segment =
        segment_with_target(along, solve, segment_of(along, low), segment_of(along, to->m));
    along->x = anhyst_clamp(meet(along, solve, segment), low, to->m);
    m = moving(along, along->active, along->x) + along->rest;
    to->way = along->falling == 0 ? 1 : -1;
  }
  remember(along, along->x, low, &to->memory);
  return m;
}

static int32_t cells_field(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                           int32_t flux, anhyst_candidate *to)
{
  path along;
  anhyst_cells_begin(&along, words, from, plays);
  equation solve = {words[ANHYST_WORD_CELLS_AIR], 16384, 0, flux >> 4};
  (void)advance(&along, &solve, to);
  return to->memory.x;
}

/* Whether the target is met on the segment where a solved path ends, and no other cell joins or has
   joined on the way: then goes there. */
static int slid(path *along, const equation *solve, const anhyst_candidate *solved)
{
  along->falling = solved->way > 0 ? 0 : -1;
  along->active =
      (int16_t)anhyst_clamp(anhyst_abs_q31(solved->memory.p), 1, (int32_t)along->cells + 1);
  along->rest = inside(turned(solved->memory.y, along->falling));
  const int32_t end = inside(turned(solved->memory.x, along->falling));
  const int16_t segment = segment_of(along, end);
  equation there = *solve;
  there.target = turned(solve->target, along->falling);
  along->x = meet(along, &there, segment);
  return solved->way != 0 && there.target >= at_node(along, &there, segment) &&
         there.target <= at_node(along, &there, (int16_t)(segment + 1)) &&
         along->x > solved->memory.level && along->x < solved->m;
}

static int32_t cells_flux(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                          const anhyst_candidate *solved, const anhyst_arms *arms, int32_t current,
                          anhyst_memory *to)
{
  path along;
  int32_t m;
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms->flux_arm, arms->field_arm,
                          (current >> 2) - (arms->bias >> 2)};
  anhyst_cells_rows(&along, words);
  if (slid(&along, &solve, solved)) {
    *to = solved->memory;
    to->x = turned(along.x, along.falling);
    m = moving(&along, along.active, along.x) + along.rest;
  } else {
    anhyst_candidate found;
    equation again = solve;
    anhyst_cells_begin(&along, words, from, plays);
    m = advance(&along, &again, &found);
    *to = found.memory;
  }
  const int32_t flux = (m >> 2) + anhyst_scale(along.x, solve.air);
  return anhyst_shl_q31(turned(flux, along.falling), 2);
}

const anhyst_kernel anhyst_kernel_cells = {ANHYST_KIND_CELLS,  cells_field,
                                           cells_flux,         anhyst_cells_is_valid,
                                           anhyst_cells_carry, anhyst_cells_keep};
