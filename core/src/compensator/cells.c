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

/* A residual that is nothing but rounding: the iron stays where it is, as it does while the target
   lies between what rows of either direction give. */
#define STILL 8

/* What is solved for, over 4. */
typedef struct {
  int16_t air;
  int16_t flux_arm;
  int16_t field_arm;
  int32_t target; /* in the direction of the path */
} equation;

/* h*x + m, over 4. |x| <= 1 */
static int32_t flux_at(const equation *solve, int32_t x, int32_t m)
{
  return (m >> 2) + anhyst_scale(x, solve->air);
}

static int32_t left_side(const equation *solve, int32_t x, int32_t m)
{
  return anhyst_scale(flux_at(solve, x, m), solve->flux_arm) +
         (anhyst_scale(x, solve->field_arm) >> 2);
}

/* What is missing of the target at a place of the row. */
static int32_t missing_at(const cell_path *along, const equation *solve, int32_t x,
                          anhyst_spot spot)
{
  return solve->target - left_side(solve, x, anhyst_value_at(spot) + along->rest);
}

/* The field at the lower end of a segment. */
static int32_t node(const cell_path *along, int16_t segment)
{
  int16_t first = 0;
  int32_t begin = -ONE;
  uint16_t fine = along->wide;
  if (segment >= along->stride - 1 - along->outer) {
    first = (int16_t)(along->stride - 1 - along->outer);
    begin = along->inner;
  } else if (segment >= along->outer) {
    first = along->outer;
    begin = -along->inner;
    fine = along->narrow;
  }
  const uint32_t way = (uint32_t)(segment - first) << 15 << fine;
  return (int32_t)((uint32_t)begin + way);
}

/* The segment of a row that holds x. */
static int16_t segment_of(const cell_path *along, int32_t x)
{
  return (int16_t)(spot_on(along, along->row, x).at - along->row);
}

/* n/d as a q15, rounded down by up to two units; 0 <= n < d. */
static int32_t part_of(int32_t n, int32_t d)
{
  const uint16_t up = anhyst_headroom(d);
  const int32_t top = (int32_t)((uint32_t)n << up);
  const int32_t bottom = ((int32_t)((uint32_t)d << up) >> 15) + 1;
  return top / bottom;
}

/* Which part of a segment the target is met at, from one of its parts and what is missing there;
   -1, 0x8000: before, behind it. A part of 2^-15 is 2^fine. */
static int32_t part_with_target(const equation *solve, int32_t from, int16_t row_rise,
                                uint16_t fine, int32_t missing)
{
  const int32_t rise =
      left_side(solve, (int32_t)((uint32_t)0x8000 << fine), (int32_t)row_rise * 32768);
  if (missing >= rise) {
    return 0x8000;
  }
  if (missing <= -rise) {
    return -1;
  }
  const int32_t way = missing >= 0 ? part_of(missing, rise) : ~part_of(-missing, rise);
  return anhyst_clamp(from + way, -1, 0x8000);
}

/* Which part of its segment x is at. Segments begin at multiples of their width. */
static int32_t part_at(int32_t x, uint16_t fine) { return (x >> fine) & 0x7FFF; }

/* The field at another part of the segment that holds x. */
static int32_t beside(int32_t x, uint16_t fine, int32_t part)
{
  return (int32_t)((uint32_t)((x >> fine) - part_at(x, fine) + part) << fine);
}

static int16_t rise_of(const int16_t *segment) { return (int16_t)(segment[1] - segment[0]); }

/* Where a cell joins a path that has come to low; beyond the last cell: the end of the rows. */
static int32_t joins_at(const cell_path *along, int16_t cell, int32_t low)
{
  if (cell > along->cells) {
    return ONE - 1;
  }
  const int32_t at = anhyst_add_q31(play_of(along, cell), width(along, cell));
  return anhyst_clamp(at, low, ONE - 1);
}

/* What a cell rests with that a path the other way has left. */
static int32_t left_with(const cell_path *along, int16_t cell)
{
  if (cell < along->moved) {
    const anhyst_spot there = {along->left.at + rows_on(along, (int16_t)(cell - 1)),
                               along->left.part};
    return -beyond(along, there);
  }
  return -beyond(along, spot_on(along, row_of(along, cell), ~left_at(along, cell)));
}

/* Whether a cell came to rest on a path of this direction. */
static int follows(const cell_path *along, int16_t cell)
{
  return (((uint32_t)turned(along->frozen, along->falling) >> ((uint16_t)cell & 31U)) & 1U) != 0U;
}

/* What is missing of the target at the beginning of a segment. */
static int32_t missing_before(const cell_path *along, const equation *solve, int16_t segment)
{
  const anhyst_spot spot = {along->row + segment, 0};
  return missing_at(along, solve, node(along, segment), spot);
}

/* The last segment of first..end at the beginning of which the target is not reached, and what is
   missing there; or first. Steps double, then halve. */
static int16_t segment_with_target(const cell_path *along, const equation *solve, int16_t first,
                                   int16_t end, int32_t *missing)
{
  int16_t step = 1;
  while (first + step <= end) {
    const int16_t next = (int16_t)(first + step);
    const int32_t left = missing_before(along, solve, next);
    if (left <= 0) {
      end = (int16_t)(next - 1);
      break;
    }
    first = next;
    *missing = left;
    step = (int16_t)(2 * step);
  }
  while (first < end) {
    const int16_t middle = (int16_t)((first + end + 1) / 2);
    const int32_t left = missing_before(along, solve, middle);
    if (left <= 0) {
      end = (int16_t)(middle - 1);
    } else {
      first = middle;
      *missing = left;
    }
  }
  return first;
}

/* Goes to the target on the row of the cells that move, between low and high; beyond the segment
   that holds low by a search. */
static void go(cell_path *along, const equation *solve, int32_t low, int32_t high)
{
  const anhyst_spot spot = spot_on(along, along->row, low);
  const int16_t first = (int16_t)(spot.at - along->row);
  int32_t begin = low;
  int32_t missing = missing_at(along, solve, low, spot);
  int32_t part =
      part_with_target(solve, spot.part, rise_of(spot.at), fineness(along, low), missing);
  along->segment = spot.at;
  if (part > 0x7FFF) {
    const int16_t end = segment_of(along, high);
    const int16_t segment = segment_with_target(along, solve, first, end, &missing);
    if (segment > first) {
      begin = node(along, segment);
      along->segment = along->row + segment;
      part = part_with_target(solve, 0, rise_of(along->segment), fineness(along, begin), missing);
    }
  }
  const int32_t there = beside(begin, fineness(along, begin), anhyst_clamp(part, 0, 0x7FFF));
  along->x = anhyst_clamp(there, low, high);
}

/* Whether the target lies beyond a place of the row. */
static int passes(const cell_path *along, const equation *solve, int32_t x)
{
  return missing_at(along, solve, x, spot_on(along, along->row, x)) > 0;
}

/* Lets so many cells move, more or fewer of those that a path the other way has left. */
static void let_move(cell_path *along, int16_t cells)
{
  const int16_t *left = along->left.at;
  const anhyst_spot now = {left + rows_on(along, (int16_t)(along->active - 1)), along->left.part};
  along->rest = inside(along->rest + between(now, left + rows_on(along, (int16_t)(cells - 1))));
  along->active = cells;
  along->row = row_of(along, cells);
}

/* From here on, the cells from the next one on that came to rest where that did, on a path the
   other way, are those which that has left. */
static void find_left(cell_path *along)
{
  int16_t cell = along->active;
  const int32_t x = left_at(along, cell);
  do {
    cell++;
  } while (cell <= along->cells && !follows(along, cell) && left_at(along, cell) == x);
  along->left = spot_on(along, along->rows, ~x);
  along->x = x;
  along->moved = cell;
}

/* Lets the cells join that a path the other way has left in one place, *next, as far as they do so
   before the target is reached; the first of them does. They do it one after the other: how many is
   found by halving, once it is more than one. Gives the next that joins at *next, and whether the
   target is known to lie before that. */
static int gather_left(cell_path *along, const equation *solve, int32_t *next)
{
  const int32_t place = *next;
  int16_t least = (int16_t)(along->active + 1);
  int16_t most = along->moved;
  int16_t cell = least;
  int met = 0;
  along->low = place;
  while (least < most) {
    let_move(along, cell);
    const int32_t there = joins_at(along, cell, place);
    if (passes(along, solve, there)) {
      along->low = there;
      least = (int16_t)(cell + 1);
    } else {
      *next = there;
      met = 1;
      most = cell;
    }
    cell = (int16_t)((least + most) / 2);
  }
  if (along->active != least) {
    let_move(along, least);
  }
  if (met == 0 || *next <= along->low) {
    *next = joins_at(along, least, along->low);
    met = 0;
  }
  return met;
}

/* Lets the cells join that a path of this direction has left in one place, which is here. Gives
   where the next one joins. */
static int32_t gather_here(cell_path *along, anhyst_spot here, int32_t place)
{
  int16_t cell = along->active;
  int32_t next = place;
  do {
    cell++;
    next = joins_at(along, cell, place);
  } while (next == place && cell <= along->cells && follows(along, cell));
  const int32_t step = (cell - along->active) * along->stride;
  along->rest = inside(along->rest - between(here, here.at + step));
  along->active = cell;
  along->row += step;
  along->low = place;
  return next;
}

/* Goes on from x, which is below the target: lets the cells join that do so on the way, the next of
   them at *next. */
static void pursue(cell_path *along, const equation *solve, int32_t x, int32_t *next)
{
  int32_t low = x;
  int met = 0;
  while (met == 0 && along->active <= along->cells) {
    const anhyst_spot here = spot_on(along, along->row, *next);
    if (*next > low && missing_at(along, solve, *next, here) <= 0) {
      break;
    }
    if (along->active >= along->moved && follows(along, along->active)) {
      *next = gather_here(along, here, *next);
    } else {
      if (along->active >= along->moved) {
        find_left(along);
      }
      met = gather_left(along, solve, next);
    }
    low = along->low;
  }
  if (along->active > along->cells) {
    along->rest = 0; /* none rests */
  }
  go(along, solve, low, *next);
}

/* Where the cell before this one joined a path that began with so many at a place. */
static int32_t joined_before(const cell_path *along, int16_t cell, int16_t least, int32_t begin)
{
  return cell > least ? joins_at(along, (int16_t)(cell - 1), begin) : begin;
}

/* Lets the last cell that joined rest again, which it did here; with those that a path of this
   direction had left in the same place, where it is one of them. */
static void part(cell_path *along, anhyst_spot here, int16_t least, int32_t begin)
{
  const int32_t place = along->low;
  int16_t cell = (int16_t)(along->active - 1);
  int32_t low = joined_before(along, cell, least, begin);
  int32_t rest = 0;
  if (follows(along, cell)) {
    while (low == place && cell > least && follows(along, (int16_t)(cell - 1))) {
      cell--;
      low = joined_before(along, cell, least, begin);
    }
    const int16_t *with = here.at;
    here.at -= rows_on(along, (int16_t)(along->active - cell));
    rest = between(here, with);
  } else {
    rest = left_with(along, cell);
  }
  along->rest = inside(along->rest + rest);
  along->active = cell;
  along->row = row_of(along, cell);
  along->low = low < place ? low : place;
}

/* Goes back from where the target was passed, at most to where the path began, beyond which it
   lies. */
static void retreat(cell_path *along, const equation *solve, int16_t least, int32_t begin,
                    int32_t *next)
{
  while (along->active > least) {
    const anhyst_spot here = spot_on(along, along->row, along->low);
    if (missing_at(along, solve, along->low, here) > 0) {
      break;
    }
    *next = along->low;
    part(along, here, least, begin);
  }
  go(along, solve, along->low, *next);
}

/* Leaves a path for the opposite one: all but cell 0 rest. */
static void turn(cell_path *along, anhyst_spot here)
{
  const anhyst_spot first = {here.at - rows_on(along, (int16_t)(along->active - 1)), here.part};
  const int32_t left = between(first, here.at);
  const uint32_t moved = ((uint32_t)1 << (uint16_t)along->active) - 1U;
  const uint32_t others = (uint32_t)along->frozen & ~moved;
  along->frozen = (int32_t)(along->falling == 0 ? others | moved : others);
  along->rest = ~inside(along->rest + left);
  along->x = ~along->x;
  along->falling = ~along->falling;
  along->moved = along->active;
  along->left = first;
  along->active = 1;
  along->row = along->rows;
}

static void remember(const cell_path *along, anhyst_memory *to)
{
  to->x = turned(along->x, along->falling);
  to->y = turned(along->rest, along->falling);
  to->p = along->falling == 0 ? along->active : -along->active;
  to->turn = along->frozen;
  to->level = along->low;
}

/* The same, as what was solved for: on a segment of so fine parts. */
static void propose(const cell_path *along, uint16_t fine, int moves, int32_t next,
                    anhyst_candidate *to)
{
  to->m = next;
  to->way = 0;
  if (moves) {
    to->way = along->falling == 0 ? 1 : -1;
  }
  to->y_slope = along->segment[0];
  to->m_slope = rise_of(along->segment);
  to->fine = fine;
  remember(along, &to->memory);
}

/* Turns again where the opposite path does not lead on: all is as it was before, but for what only
   a path needs that goes on. */
static void turn_back(cell_path *along, int32_t rest, int32_t frozen)
{
  along->x = ~along->x;
  along->falling = ~along->falling;
  along->active = along->moved;
  along->rest = rest;
  along->frozen = frozen;
}

/* Goes on from a spot to a target that is missing there by so much; where that is negative, on the
   opposite path. Between the two, where rows are not quite odd, it stays. */
static void travel(cell_path *along, equation *solve, anhyst_spot spot, int32_t missing,
                   anhyst_candidate *to)
{
  const int32_t rest = along->rest;
  const int32_t frozen = along->frozen;
  int32_t next = along->x;
  if (missing < 0) {
    turn(along, spot);
    const anhyst_spot here = spot_on(along, along->row, along->x);
    solve->target = ~solve->target;
    missing = missing_at(along, solve, along->x, here);
    if (missing > 0) {
      along->segment = here.at;
    } else {
      turn_back(along, rest, frozen);
    }
    next = along->x;
  }
  if (missing > STILL) {
    along->low = along->x;
    next = joins_at(along, along->active, along->x);
    pursue(along, solve, along->x, &next);
  }
  propose(along, fineness(along, along->x), missing > STILL, next, to);
}

/* Solves from a memory on. As long as the path meets the target on its segment it stays in
   registers: what goes further goes on as a copy. */
static void advance(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                    equation *solve, anhyst_candidate *to)
{
  cell_path along;
  anhyst_cells_begin(&along, words, from, plays);
  solve->target = turned(solve->target, along.falling);
  const anhyst_spot spot = spot_on(&along, along.row, along.x);
  const int32_t missing = missing_at(&along, solve, along.x, spot);
  along.segment = spot.at;
  if (missing >= -STILL) {
    const uint16_t fine = fineness(&along, along.x);
    if (missing <= STILL) {
      propose(&along, fine, 0, along.x, to);
      return;
    }
    const int32_t met = part_with_target(solve, spot.part, rise_of(spot.at), fine, missing);
    const int32_t there = beside(along.x, fine, met);
    const int32_t next = joins_at(&along, along.active, along.x);
    if (met <= 0x7FFF && there >= along.x && there <= next) {
      along.low = along.x;
      along.x = there;
      propose(&along, fine, 1, next, to);
      return;
    }
  }
  cell_path on = along;
  travel(&on, solve, spot, missing, to);
}

static int32_t cells_field(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                           int32_t flux, anhyst_candidate *to)
{
  equation solve = {words[ANHYST_WORD_CELLS_AIR], 16384, 0, flux >> 4};
  advance(words, from, plays, &solve, to);
  return to->memory.x;
}

/* Stands where a path was solved to; gives where the next cell joins. */
static int32_t take_up(cell_path *along, const anhyst_candidate *solved)
{
  along->falling = solved->way > 0 ? 0 : -1;
  const int32_t active = turned(solved->memory.p, along->falling) - along->falling;
  along->active = (int16_t)anhyst_clamp(active, 1, (int32_t)along->cells + 1);
  along->row = row_of(along, along->active);
  along->rest = inside(turned(solved->memory.y, along->falling));
  along->frozen = solved->memory.turn;
  along->x = inside(turned(solved->memory.x, along->falling));
  along->low = anhyst_clamp(solved->memory.level, -ONE, along->x);
  return anhyst_clamp(solved->m, along->x, ONE - 1);
}

/* h*x + m at a place of a segment that begins with this entry of the row. */
static int32_t flux_with(const equation *solve, int32_t x, int32_t rest, int16_t entry,
                         int16_t rise, uint16_t fine)
{
  const int32_t m = (int32_t)entry * 32768 + (int32_t)rise * part_at(x, fine) + rest;
  return flux_at(solve, x, m);
}

/* The flux to which a solved step leads. */
static int32_t flux_reached(const equation *solve, const anhyst_candidate *at)
{
  const int32_t falling = at->memory.p < 0 ? -1 : 0;
  const int32_t flux = flux_with(solve, turned(at->memory.x, falling),
                                 turned(at->memory.y, falling), at->y_slope, at->m_slope, at->fine);
  return anhyst_shl_q31(turned(flux, falling), 2);
}

/* Goes to the target from a solved path if it is met on the same segment, before any cell joins or
   rests: 0. 1, -1: it lies further on, further back. */
static int slid(const equation *solve, const anhyst_candidate *solved, anhyst_memory *to,
                int32_t *flux)
{
  const int32_t falling = solved->way > 0 ? 0 : -1;
  const uint16_t fine = solved->fine;
  const int32_t x = inside(turned(solved->memory.x, falling));
  const int32_t rest = inside(turned(solved->memory.y, falling));
  const int32_t here = flux_with(solve, x, rest, solved->y_slope, solved->m_slope, fine);
  const int32_t missing = solve->target - anhyst_scale(here, solve->flux_arm) -
                          (anhyst_scale(x, solve->field_arm) >> 2);
  const int32_t met = part_with_target(solve, part_at(x, fine), solved->m_slope, fine, missing);
  const int32_t there = beside(x, fine, met);
  if (met < 0 || met > 0x7FFF || there < solved->memory.level || there > solved->m) {
    return missing > 0 ? 1 : -1;
  }
  const int32_t found = flux_with(solve, there, rest, solved->y_slope, solved->m_slope, fine);
  *to = solved->memory;
  to->x = turned(there, falling);
  *flux = anhyst_shl_q31(turned(found, falling), 2);
  return 0;
}

/* The same further away, from a memory in the direction that it had; 0: the target does not lie in
   that direction. */
static int resumed(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                   const equation *solve, const anhyst_candidate *solved, int further,
                   anhyst_candidate *to)
{
  cell_path along;
  anhyst_cells_begin(&along, words, from, plays);
  if ((solved->way < 0) != (along.falling < 0)) {
    turn(&along, spot_on(&along, along.row, along.x));
  }
  const int32_t begin = along.x;
  const int16_t least = along.active;
  if (further < 0 && !passes(&along, solve, begin)) {
    return 0;
  }
  int32_t next = take_up(&along, solved);
  const int32_t x = along.x;
  along.x = begin;
  if (further > 0) {
    pursue(&along, solve, x, &next);
  } else {
    retreat(&along, solve, least, begin, &next);
  }
  propose(&along, fineness(&along, along.x), 1, next, to);
  return 1;
}

static int32_t cells_flux(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                          const anhyst_candidate *solved, const anhyst_arms *arms, int32_t current,
                          anhyst_memory *to)
{
  const int32_t target = (current >> 2) - (arms->bias >> 2);
  const equation near = {words[ANHYST_WORD_CELLS_AIR], arms->flux_arm, arms->field_arm,
                         solved->way < 0 ? ~target : target};
  int further = 0;
  if (solved->way != 0) {
    int32_t flux = 0;
    further = slid(&near, solved, to, &flux);
    if (further == 0) {
      return flux;
    }
  }
  anhyst_candidate found;
  equation solve = near;
  if (further == 0 || !resumed(words, from, plays, &solve, solved, further, &found)) {
    solve.target = target;
    advance(words, from, plays, &solve, &found);
  }
  *to = found.memory;
  return flux_reached(&solve, &found);
}

#if ANHYST_MEMORIES > 1
int32_t anhyst_cells_meet(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                          const anhyst_arms *arms, int32_t target, anhyst_candidate *to)
{
  equation solve = {words[ANHYST_WORD_CELLS_AIR], arms->flux_arm, arms->field_arm, target};
  advance(words, from, plays, &solve, to);
  return flux_reached(&solve, to);
}
#endif

const anhyst_kernel anhyst_kernel_cells = {
    ANHYST_KIND_CELLS,  cells_field,       cells_flux,        anhyst_cells_is_valid,
    anhyst_cells_carry, anhyst_cells_keep, anhyst_cells_start};
