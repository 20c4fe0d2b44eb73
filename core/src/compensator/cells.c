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
#define STILL 32

/* So many segments a path goes on one by one. */
#define NEAR 4

/* What is missing of a target, over 4, of a path that goes far. */
#define FAR (ONE / 64)

/* What is solved for, over 4. */
typedef struct {
  int16_t air;
  const anhyst_arms *arms; /* of a current; 0: a flux */
  int32_t target;
} equation;

/* h*x + m, over 4. |x| <= 1 */
static inline int32_t flux_at(const equation *solve, int32_t x, int32_t m)
{
  return (m >> 2) + anhyst_scale(x, solve->air);
}

/* What is solved for, where flux and field are so much. */
static inline int32_t left_side(const equation *solve, int32_t flux, int32_t x)
{
  if (solve->arms == 0) {
    return flux;
  }
  return anhyst_scale(flux, solve->arms->flux_arm) + (anhyst_scale(x, solve->arms->field_arm) >> 2);
}

/* What is missing of the target at a place of the row. */
static int32_t missing_at(const cell_path *along, const equation *solve, int32_t x,
                          anhyst_spot spot)
{
  return solve->target -
         left_side(solve, flux_at(solve, x, anhyst_value_at(spot) + along->rest), x);
}

/* The field at the lower end of a segment. */
static int32_t node(const cell_path *along, int segment)
{
  int first = 0;
  int32_t begin = -ONE;
  unsigned fine = along->wide;
  if (segment >= along->stride - 1 - along->outer) {
    first = along->stride - 1 - along->outer;
    begin = along->inner;
  } else if (segment >= along->outer) {
    first = along->outer;
    begin = -along->inner;
    fine = along->narrow;
  }
  const uint32_t way = (uint32_t)(segment - first) << 15 << fine;
  return (int32_t)((uint32_t)begin + way);
}

/* n/d as a q15, rounded down by up to two units; 0 <= n < d. */
static inline int32_t part_of(int32_t n, int32_t d)
{
  const uint16_t up = anhyst_headroom(d);
  const int32_t top = (int32_t)((uint32_t)n << up);
  const int32_t bottom = ((int32_t)((uint32_t)d << up) >> 15) + 1;
  return top / bottom;
}

/* Which part of a segment the target is met at, of which so much is missing where it begins; 0,
   0x8000: not behind there, beyond it. */
static inline int32_t part_with_target(const equation *solve, const int16_t *segment, unsigned fine,
                                       int32_t missing)
{
  const int32_t width = (int32_t)((uint32_t)0x8000 << fine);
  const int32_t rise =
      left_side(solve, flux_at(solve, width, ((int32_t)segment[1] - segment[0]) * 32768), width);
  if (missing >= rise) {
    return 0x8000;
  }
  return missing > 0 ? anhyst_sat_u15(part_of(missing, rise)) : 0;
}

/* Which part of its segment x is at. Segments begin at multiples of their width. */
static inline int32_t part_at(int32_t x, unsigned fine) { return (x >> fine) & 0x7FFF; }

/* Where the segment begins that holds x. */
static inline int32_t begin_of(int32_t x, unsigned fine)
{
  return (int32_t)((uint32_t)(x >> fine >> 15) << 15 << fine);
}

/* The field at a part of the segment that begins there. */
static inline int32_t place_in(int32_t begin, unsigned fine, int32_t part)
{
  return (int32_t)((uint32_t)begin + ((uint32_t)part << fine));
}

/* Where a cell joins a path that has come to low; beyond the last cell: the end of the rows. */
static int32_t joins_at(const cell_path *along, int cell, int32_t low)
{
  if (cell > along->cells) {
    return ONE - 1;
  }
  const int32_t at = inside(anhyst_add_q31(play_of(along, cell), width(along, cell)));
  return at > low ? at : low;
}

/* Whether a cell came to rest on a path of this direction. */
static int follows(const cell_path *along, int cell)
{
  return (((uint32_t)turned(along->frozen, along->falling) >> ((unsigned)cell & 31U)) & 1U) != 0U;
}

/* From here on, the cells from the next one to the last that came to rest where that did, on a path
   the other way, are those which that has left. The next one alone where the last comes before. */
static void find_left(cell_path *along, int last)
{
  int cell = along->active;
  const int32_t x = left_at(along, cell);
  do {
    cell++;
  } while (cell <= last && !follows(along, cell) && left_at(along, cell) == x);
  along->left = spot_on(along, along->rows, ~x);
  along->x = x;
  along->moved = cell;
}

/* What the next cell rests with, which joins here; with it, up to the last, those left together. */
static int32_t rests_with(cell_path *along, anhyst_spot here, int last)
{
  if (follows(along, along->active)) {
    return beyond(along, here);
  }
  if (along->active >= along->moved) {
    find_left(along, last);
  }
  const anhyst_spot there = {along->left.at + rows_on(along, along->active - 1), along->left.part};
  return -beyond(along, there);
}

/* Goes to the target on the row of the cells that move, between low, which is here, and high.
   Beyond the segment that holds low the last one is looked for at the beginning of which it is not
   met. */
static void go(cell_path *along, const equation *solve, anhyst_spot here, int32_t low, int32_t high)
{
  unsigned fine = fineness(along, low);
  int32_t begin = begin_of(low, fine);
  anhyst_spot first = {here.at, 0};
  int32_t part = part_with_target(solve, here.at, fine, missing_at(along, solve, begin, first));
  if (part > 0x7FFF) {
    int segment = (int)(here.at - along->row);
    int end = (int)(spot_on(along, along->row, high).at - along->row);
    int32_t missing = ANHYST_Q31_MAX;
    while (segment < end) {
      const int middle = (segment + end + 1) / 2;
      const int32_t place = node(along, middle);
      first.at = along->row + middle;
      const int32_t left = missing_at(along, solve, place, first);
      if (left <= 0) {
        end = middle - 1;
      } else {
        segment = middle;
        begin = place;
        missing = left;
      }
    }
    first.at = along->row + segment;
    fine = fineness(along, begin);
    part = part_with_target(solve, first.at, fine, missing);
  }
  along->segment = first.at;
  along->x = anhyst_clamp(place_in(begin, fine, anhyst_sat_u15(part)), low, high);
}

/* Lets so many cells move, of those that the turn of this path has left. */
static void let_move(cell_path *along, int cells)
{
  const anhyst_spot now = {along->left.at + rows_on(along, along->active - 1), along->left.part};
  const int16_t *then = along->left.at + rows_on(along, cells - 1);
  along->rest = inside(along->rest + between(now, then));
  along->active = cells;
  along->row = row_of(along, cells);
}

/* Lets those cells join again that the turn of this path has left, as far as they do so before the
   target is reached. How many is found by halving. Gives where the last one does. */
static int32_t rejoin(cell_path *along, const equation *solve, int32_t low)
{
  int least = along->active;
  int most = along->moved;
  int32_t place = low;
  while (least < most) {
    const int cells = (least + most + 1) / 2;
    const int32_t next = joins_at(along, cells - 1, low);
    let_move(along, cells);
    if (missing_at(along, solve, next, spot_on(along, along->row, next)) > 0) {
      least = cells;
      place = next;
    } else {
      most = cells - 1;
    }
  }
  let_move(along, least);
  return place;
}

/* Goes on from where a path begins, below the target: lets the cells join that do so on the way.
   Gives where the next one does. Those left together are looked for up to the last, once one has
   joined among all: a short path ends before the second one joins. */
static int32_t pursue(cell_path *along, const equation *solve, anhyst_spot here, int last)
{
  int32_t low = along->x;
  int32_t next = joins_at(along, along->active, low);
  int met = 0;
  while (met == 0 && along->active <= along->cells) {
    const anhyst_spot there = spot_on(along, along->row, next);
    if (next > low && missing_at(along, solve, next, there) <= 0) {
      break;
    }
    low = next;
    here = there;
    do { /* all that join in one place */
      along->rest = inside(along->rest - rests_with(along, here, last));
      along->active++;
      here.at += along->stride;
      next = joins_at(along, along->active, low);
    } while (next == low && along->active <= along->cells);
    along->row = row_of(along, along->active);
    last = along->cells;
    if (along->active < along->moved) {
      low = rejoin(along, solve, low);
      here = spot_on(along, along->row, low);
      next = joins_at(along, along->active, low);
      met = along->active < along->moved; /* before the next of them joins */
    }
  }
  if (along->active > along->cells) {
    along->rest = 0; /* none rests */
  }
  along->low = low;
  go(along, solve, here, low, next);
  return next;
}

/* Leaves a path for the opposite one: all but cell 0 rest. */
static void turn(cell_path *along, anhyst_spot here)
{
  const anhyst_spot first = {here.at - rows_on(along, along->active - 1), here.part};
  const int32_t left = between(first, here.at);
  const uint32_t moved = ((uint32_t)1 << (unsigned)along->active) - 1U;
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

/* What is known of the segment where a candidate stands, which begins there: what its row rises on
   it, and h*x + m where it begins, over 4. */
static void describe(const int16_t *words, int32_t begin, int32_t rest, anhyst_candidate *at)
{
  const int16_t *segment = words + at->y_slope;
  at->m_slope = (int16_t)(segment[1] - segment[0]);
  at->flux = (((int32_t)segment[0] * 32768 + rest) >> 2) +
             anhyst_scale(begin, words[ANHYST_WORD_CELLS_AIR]);
}

/* What h*x + m rises on the segment of a candidate, over 4. */
static inline int32_t rise_on(const anhyst_candidate *at, int16_t air)
{
  return (int32_t)at->m_slope * 8192 + anhyst_scale((int32_t)((uint32_t)0x8000 << at->fine), air);
}

/* So much of it as belongs to a part. */
static inline int32_t share_of(int32_t rise, int32_t part)
{
  return 2 * anhyst_scale(rise, (int16_t)part);
}

/* What is known where a path has come to; gives h*x + m there, over 4. */
static int32_t arrive(const cell_path *along, const int16_t *words, anhyst_candidate *to)
{
  to->y_slope = (int16_t)(along->segment - words);
  to->fine = (uint16_t)fineness(along, along->x);
  to->memory.x = turned(along->x, along->falling);
  to->memory.y = turned(along->rest, along->falling);
  to->memory.p = along->falling == 0 ? along->active : -along->active;
  to->memory.turn = along->frozen;
  to->memory.level = along->low;
  describe(words, begin_of(along->x, to->fine), along->rest, to);
  const int32_t rise = rise_on(to, words[ANHYST_WORD_CELLS_AIR]);
  return turned(to->flux + share_of(rise, part_at(along->x, to->fine)), along->falling);
}

/* Solves from a memory on; gives h*x + m there, over 4. Between the two directions, where rows are
   not quite odd, it stays. */
static int32_t travel(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                      const anhyst_arms *arms, int32_t wanted, anhyst_candidate *to)
{
  cell_path along;
  equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  anhyst_cells_begin(&along, words, from, plays);
  solve.target = turned(wanted, along.falling);
  anhyst_spot here = spot_on(&along, along.row, along.x);
  int32_t missing = missing_at(&along, &solve, along.x, here);
  along.segment = here.at;
  if (missing < -STILL) {
    turn(&along, here);
    solve.target = ~solve.target;
    here = spot_on(&along, along.row, along.x);
    missing = missing_at(&along, &solve, along.x, here);
    if (missing <= STILL) {
      anhyst_cells_begin(&along, words, from, plays);
    }
  }
  along.low = along.x;
  if (missing > STILL) {
    to->m = pursue(&along, &solve, here, missing > FAR ? along.cells : 0);
  } else {
    to->m = joins_at(&along, along.active, along.x);
  }
  return arrive(&along, words, to);
}

/* Takes a candidate on to where the next segment begins, if no cell joins before; whether it does.
 */
static int stepped(const int16_t *words, anhyst_candidate *at)
{
  const int32_t falling = at->memory.p < 0 ? -1 : 0;
  const int32_t end = place_in(begin_of(turned(at->memory.x, falling), at->fine), at->fine, 0x8000);
  const int32_t next = at->y_slope + 1;
  if (end > at->m || next <= words[ANHYST_WORD_CELLS_ROWS] ||
      next >= words[ANHYST_WORD_LENGTH] - 1) {
    return 0;
  }
  const uint16_t halvings = (uint16_t)words[ANHYST_WORD_CELLS_ZONE];
  const int32_t inner = ONE >> halvings;
  if (end == -inner) {
    at->fine = (uint16_t)(at->fine - halvings);
  } else if (end == inner) {
    at->fine = (uint16_t)(at->fine + halvings);
  }
  at->memory.x = turned(end, falling);
  at->y_slope = (int16_t)next;
  describe(words, end, turned(at->memory.y, falling), at);
  return 1;
}

/* What comes of going to a target on a segment. */
enum { NOT_MET, MET, BEYOND };

/* Goes to a target from where a candidate stands, on its segment, not below where the step or the
   last cell began, in its direction, and no further than to where a cell joins; whether it is met
   there, and h*x + m there. As much behind that as rounding takes away it stays there. BEYOND: it
   is on one of the next segments. */
static inline int met_on_segment(const int16_t *words, const anhyst_arms *arms, int32_t wanted,
                                 anhyst_candidate *at, int32_t *flux)
{
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  const int32_t falling = at->memory.p < 0 ? -1 : 0;
  const int32_t low = at->memory.level;
  const unsigned fine = at->fine;
  const int32_t begin = begin_of(turned(at->memory.x, falling), fine);
  const int32_t rise = rise_on(at, solve.air);
  const int32_t whole = left_side(&solve, rise, (int32_t)((uint32_t)0x8000 << fine));
  /* What a damaged candidate says may be anything: differences wrap. */
  const int32_t missing =
      (int32_t)((uint32_t)turned(wanted, falling) - (uint32_t)left_side(&solve, at->flux, begin));
  if (missing < 0) {
    return NOT_MET;
  }
  if (missing >= whole) {
    return missing / NEAR < whole ? BEYOND : NOT_MET;
  }
  const int32_t part = anhyst_sat_u15(part_of(missing, whole));
  int32_t x = place_in(begin, fine, part);
  if (x < low) {
    if ((uint32_t)low - (uint32_t)x > (uint32_t)4 << fine) {
      return NOT_MET;
    }
    x = low;
  }
  at->memory.x = turned(x, falling);
  *flux = turned((int32_t)((uint32_t)at->flux + (uint32_t)share_of(rise, part)), falling);
  return x <= at->m ? MET : NOT_MET;
}

/* Goes to a target that lies beyond the segment of a candidate, or else from the memory on; gives
   h*x + m there, over 4. */
static int32_t go_beyond(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                         const anhyst_arms *arms, int32_t wanted, anhyst_candidate *at, int met)
{
  int32_t flux = 0;
  for (int more = NEAR - 1; met == BEYOND && more > 0 && stepped(words, at); more--) {
    met = met_on_segment(words, arms, wanted, at, &flux);
  }
  return met == MET ? flux : travel(words, from, plays, arms, wanted, at);
}

/* Goes to a target from where a candidate stands, if it says so, or else from the memory on; gives
   h*x + m there, over 4. */
static int32_t reach(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                     const anhyst_arms *arms, int32_t wanted, anhyst_candidate *at)
{
  int32_t flux = 0;
  const int met = is_placed(at) ? met_on_segment(words, arms, wanted, at, &flux) : NOT_MET;
  return met == MET ? flux : go_beyond(words, from, plays, arms, wanted, at, met);
}

static int32_t cells_flux(anhyst_compensator *c, int32_t current)
{
  const anhyst_arms *arms = &c->arms;
  const int32_t target = (current >> 2) - (arms->bias >> 2);
  const int32_t flux = reach(c->words, &c->memory, c->plays, arms, target, &c->next);
  const int32_t half = anhyst_add_q31(flux, flux);
  return anhyst_add_q31(half, half);
}

/* A flux that needs more than a limit of the current even with the field where it is, which goes
   the same way, leads to that limit, and asks for all the field there is. */
static int32_t cells_field(anhyst_compensator *c)
{
  const int16_t *words = c->words;
  const anhyst_arms *arms = &c->arms;
  anhyst_candidate *at = &c->next;
  const int32_t target = c->flux >> 2;
  int32_t flux;
  at->memory.level = inside(turned(c->memory.x, at->memory.p < 0 ? -1 : 0));
  const int met = is_placed(at) ? met_on_segment(words, 0, target, at, &flux) : NOT_MET;
  if (met == MET) {
    return at->memory.x;
  }
  const int rises = c->flux > c->flux_applied;
  const int32_t end = words[rises ? ANHYST_WORD_CURRENT_HIGH : ANHYST_WORD_CURRENT_LOW];
  const int32_t limit = (end * 32768) >> words[ANHYST_WORD_CURRENT_SHIFT];
  const int32_t least = arms->bias + anhyst_scale(c->flux, arms->flux_arm) +
                        anhyst_scale(inside(c->memory.x), arms->field_arm);
  if (arms->flux_arm >= 0 && (rises ? least > limit : least < limit)) {
    (void)cells_flux(c, limit);
    return rises ? ONE - 1 : -ONE;
  }
  (void)go_beyond(words, &c->memory, c->plays, 0, target, at, met);
  return at->memory.x;
}

static void cells_carry(anhyst_compensator *c, const int16_t *words, int32_t flux)
{
  anhyst_cells_carry(c->words, words, flux, &c->memory, c->plays);
}

static void cells_keep(anhyst_compensator *c)
{
  if (have_turned(&c->memory, &c->next.memory)) {
    anhyst_cells_keep(c->words, &c->memory, c->plays);
  }
}

static void cells_start(anhyst_compensator *c)
{
  anhyst_cells_start(c->words, c->plays, &c->memory);
}

#if ANHYST_MEMORIES > 1
int32_t anhyst_cells_flux_of(const int16_t *words, const anhyst_candidate *at)
{
  const int32_t falling = at->memory.p < 0 ? -1 : 0;
  const int32_t x = turned(at->memory.x, falling);
  const int32_t rise = rise_on(at, words[ANHYST_WORD_CELLS_AIR]);
  const int32_t flux = turned(at->flux + share_of(rise, part_at(x, at->fine)), falling);
  return anhyst_shl_q31(flux, 2);
}

int32_t anhyst_cells_meet(const int16_t *words, const anhyst_memory *from, const int32_t *plays,
                          const anhyst_arms *arms, int32_t target, anhyst_candidate *to)
{
  (void)reach(words, from, plays, arms, target, to);
  return anhyst_cells_flux_of(words, to);
}

int32_t anhyst_cells_stand(const int16_t *words, const anhyst_memory *memory, const int32_t *plays,
                           anhyst_candidate *at)
{
  cell_path along;
  anhyst_cells_begin(&along, words, memory, plays);
  along.low = along.x;
  along.segment = spot_on(&along, along.row, along.x).at;
  at->m = joins_at(&along, along.active, along.x);
  return anhyst_shl_q31(arrive(&along, words, at), 2);
}

const anhyst_kernel *anhyst_cells_for_block(const int16_t *words)
{
  return words[ANHYST_WORD_SOLID_LAYERS] > 0 ? &anhyst_kernel_solid : &anhyst_kernel_cells;
}

#define FOR_BLOCK anhyst_cells_for_block
#else
#define FOR_BLOCK 0
#endif

const anhyst_kernel anhyst_kernel_cells = {ANHYST_KIND_CELLS,     cells_field, cells_flux,
                                           anhyst_cells_is_valid, cells_carry, cells_keep,
                                           cells_start,           FOR_BLOCK};
