/* SPDX-License-Identifier: Apache-2.0 */
/* The law of play cells: play operators in the effective field, each with a curve of its own.
   Template for one format; generic/cells_path.h is included before.

   Cell i keeps its play p within r of the field x and gives f(p); m is the sum. On a rising path
   the first cells move, all with p = x - r, and their sum is a row of a table over x. The others
   rest:

     m = T(x) + C,   T of the cells that move, C of those that rest.

   The next cell joins where x reaches p + r. The algorithm follows a rising path; a falling path
   is mirrored. Rows are straight between their entries. Therefore the equation

     flux_arm*(h*x + m) + field_arm*x = target

   is solved in closed form on a segment. C receives the value of a row when a cell comes to rest,
   and exactly the same value is subtracted when the cell joins again: C does not drift. The
   solution is rounded against the direction of the path, so that a constant target never reverses
   the path. */

/* Maximum number of segments that a search moves on from a candidate before a full solve. */
#define MAX_SEGMENT_STEPS 4

/* A path whose residual is larger than this, over 4, looks for all cells that were left together.
 */
#define LONG_PATH_RESIDUAL POWER_OF_HALF(6)

/* The equation to solve, over 4, in the direction of the path. */
typedef struct {
  entry air;
  const arms_type *arms; /* of a current; 0: the equation of a flux */
  number target;
} equation;

/* h*x + m, over 4. Requires |x| <= 1. */
static inline number flux_at(const equation *solve, number x, number m)
{
  return quarter(m) + scaled(x, solve->air);
}

/* The current of a flux and a field without its bias, over 4. */
static inline number current_at(const arms_type *arms, number flux, number x)
{
  return scaled(flux, arms->flux_arm) + quarter(scaled(x, arms->field_arm));
}

/* The left side of the equation, over 4. */
static inline number left_side(const equation *solve, number flux, number x)
{
  return solve->arms == 0 ? flux : current_at(solve->arms, flux, x);
}

/* Target minus left side at a field and a magnetisation. */
static inline number missing_at(const equation *solve, number x, number m)
{
  return solve->target - left_side(solve, flux_at(solve, x, m), x);
}

/* The field at the lower end of a segment. */
static number node(const cell_path *along, int segment)
{
  const int from_centre = segment - along->centre;
  const int zone = along->centre - along->outer;
  if (from_centre >= zone) {
    return field_at(from_centre - along->outer, along->wide);
  }
  if (from_centre < -zone) {
    return field_at(from_centre + along->outer, along->wide);
  }
  return field_at(from_centre, along->narrow);
}

/* The part of a segment where the equation is solved, given the residual at its lower end. 0: not
   above the lower end; WHOLE_SEGMENT: beyond the segment. */
static inline number part_with_target(const equation *solve, const entry *segment, grid width,
                                      number missing)
{
  const number size = width_of(width);
  const number m = level_of(segment[1]) - level_of(segment[0]);
  const number rise = left_side(solve, flux_at(solve, size, m), size);
  if (missing >= rise) {
    return WHOLE_SEGMENT;
  }
  return missing > 0 ? ratio_part(missing, rise) : 0;
}

/* The field where a cell joins a path that has reached low; after the last cell: the end of the
   rows. */
static number joins_at(const cell_path *along, int cell, number low)
{
  if (cell > along->cells) {
    return FIELD_MAX;
  }
  const number at = inside(sum(play_of(along, cell), half_width(along, cell)));
  return at > low ? at : low;
}

/* Whether a cell came to rest on a path of this direction. */
static int follows(const cell_path *along, int cell)
{
  const uint32_t risen = (uint32_t)along->risen ^ (uint32_t)(int32_t)along->mirror;
  return ((risen >> ((unsigned)cell & 31U)) & 1U) != 0U;
}

/* Sets the reversal point of the next cell as that of the path, with all cells up to the last that
   came to rest there on a path of the other direction. */
static void find_left(cell_path *along, int last)
{
  int cell = along->active;
  const number x = left_at(along, cell);
  do {
    cell++;
  } while (cell <= last && !follows(along, cell) && left_at(along, cell) == x);
  along->left = spot_on(along, along->rows, mirrored(x, -1));
  along->x = x;
  along->moved = cell;
}

/* The magnetisation with which the next cell, which joins here, was counted in the sum of the
   resting cells: where its own path left it. */
static number rests_with(cell_path *along, spot here, int last)
{
  if (follows(along, along->active)) {
    return beyond(along, here);
  }
  if (along->active >= along->moved) {
    find_left(along, last);
  }
  const spot there = {along->left.at + rows_on(along, along->active - 1), along->left.part};
  return -beyond(along, there);
}

/* Moves to the target on the row of the moving cells, between low, which is on the segment here,
   and high. After this segment, the search selects the last one whose lower end is below the
   target. */
static void go(cell_path *along, const equation *solve, const entry *here, number low, number high)
{
  grid width = grid_on(along, low);
  number begin = begin_of(low, width);
  number missing = missing_at(solve, begin, level_of(here[0]) + along->rest);
  number part = part_with_target(solve, here, width, missing);
  if (part >= WHOLE_SEGMENT) {
    int segment = (int)(here - along->row);
    int end = (int)(spot_on(along, along->row, high).at - along->row);
    missing = FIELD_MAX;
    while (segment < end) {
      const int middle = (segment + end + 1) / 2;
      const number place = node(along, middle);
      const number left = missing_at(solve, place, level_of(along->row[middle]) + along->rest);
      if (left <= 0) {
        end = middle - 1;
      } else {
        segment = middle;
        begin = place;
        missing = left;
      }
    }
    here = along->row + segment;
    width = grid_on(along, begin);
    part = part_with_target(solve, here, width, missing);
  }
  along->segment = here;
  along->x = clamped(place_in(begin, width, inner_part(part)), low, high);
}

/* Lets the cells that the reversal of this path has left join again, up to the target, by
 * bisection. Returns the field where the last of them joins. */
static number rejoin(cell_path *along, const equation *solve, number low)
{
  const spot now = {along->left.at + rows_on(along, along->active - 1), along->left.part};
  const number begin = along->rest;
  int least = along->active;
  int most = along->moved;
  while (least < most) {
    const int cells = (least + most + 1) / 2;
    const number next = joins_at(along, cells - 1, low);
    const entry *row = row_of(along, cells);
    const number rest = inside(begin + between(now, along->left.at + rows_on(along, cells - 1)));
    if (missing_at(solve, next, value_at(spot_on(along, row, next)) + rest) <= 0) {
      most = cells - 1;
    } else {
      least = cells;
      along->rest = rest;
      along->row = row;
      low = next;
    }
  }
  along->active = least;
  return low;
}

/* Lets cells join up to the target of a path that begins at a spot; returns the segment of the last
   join. Sets the field of this join, and that of the next one. Cells left together are looked for
   up to the given last one, and among all cells after one has joined: a short path ends before the
   second cell joins. */
static const entry *join(cell_path *along, const equation *solve, spot here, int last, number *end)
{
  number low = along->x;
  number next = joins_at(along, along->active, low);
  int is_ended = 0;
  while (is_ended == 0 && along->active <= along->cells) {
    const spot there = spot_on(along, along->row, next);
    if (next > low && missing_at(solve, next, value_at(there) + along->rest) <= 0) {
      break;
    }
    low = next;
    here = there;
    do { /* all cells that join in one place */
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
      is_ended = along->active < along->moved; /* the next of them joins after the target */
    }
  }
  along->low = low;
  *end = next;
  return here.at;
}

/* Follows a path that begins below the target: lets cells join, and moves to the target. Returns
   the field where the next cell joins. */
static number pursue(cell_path *along, const equation *solve, spot begin, int last)
{
  number next;
  const entry *here = join(along, solve, begin, last, &next);
  if (along->active > along->cells) {
    along->rest = 0; /* no cell rests */
  }
  go(along, solve, here, along->low, next);
  return next;
}

/* Reverses a path: all cells except cell 0 rest. */
static void turn(cell_path *along, spot here)
{
  const spot first = {here.at - rows_on(along, along->active - 1), here.part};
  const number left = between(first, here.at);
  const uint32_t moved = ((uint32_t)1 << (unsigned)along->active) - 1U;
  const uint32_t others = (uint32_t)along->risen & ~moved;
  along->risen = (int32_t)(along->mirror == 0 ? others | moved : others);
  along->rest = mirrored(inside(along->rest + left), -1);
  along->x = mirrored(along->x, -1);
  along->mirror = ~along->mirror;
  along->moved = along->active;
  along->left = first;
  along->active = 1;
  along->row = along->rows;
}

/* Describes the segment of a candidate, which begins there: its rise, and h*x + m at its lower
   end, over 4. */
static void describe(const entry *words, int segment, number begin, grid width, number rest,
                     candidate *at)
{
  set_segment(at, words, segment, begin, width);
  at->of.cells.flux = quarter(unsafe_sum(level_of(words[segment]), rest)) +
                      scaled(begin, words[ANHYST_WORD_CELLS_AIR]);
}

/* The rise of h*x + m on the segment of a candidate, over 4. */
static inline number rise_on(const candidate *at, entry air)
{
  return quarter_rise(at) + scaled(width_of(grid_at(at)), air);
}

/* Makes a candidate of the end of a path; returns h*x + m there, over 4. */
static number arrive(const cell_path *along, const entry *words, candidate *to)
{
  const grid width = grid_on(along, along->x);
  const number begin = begin_of(along->x, width);
  to->memory.cells.x = mirrored(along->x, along->mirror);
  to->memory.cells.rest = mirrored(along->rest, along->mirror);
  to->memory.cells.active = along->mirror == 0 ? along->active : -along->active;
  to->memory.cells.risen = along->risen;
  to->memory.cells.joined = along->low;
  describe(words, (int)(along->segment - words), begin, width, along->rest, to);
  const number rise = rise_on(to, words[ANHYST_WORD_CELLS_AIR]);
  return mirrored(to->of.cells.flux + rise_share(rise, part_at(along->x, begin, width)),
                  along->mirror);
}

/* Solves from a memory; returns h*x + m there, over 4. The field does not change if the target is
   between the values of the rows of the two directions, which are not quite odd. */
static number travel(const entry *words, const cells_memory *from, const number *plays,
                     const arms_type *arms, number wanted, candidate *to)
{
  cell_path along;
  equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  begin_path(&along, words, from, plays);
  solve.target = mirrored(wanted, along.mirror);
  spot here = spot_on(&along, along.row, along.x);
  number missing = missing_at(&solve, along.x, value_at(here) + along.rest);
  along.segment = here.at;
  if (missing < -RESIDUAL_DEADBAND) {
    turn(&along, here);
    solve.target = mirrored(solve.target, -1);
    here = spot_on(&along, along.row, along.x);
    missing = missing_at(&solve, along.x, value_at(here) + along.rest);
    if (missing <= RESIDUAL_DEADBAND) {
      begin_path(&along, words, from, plays);
    }
  }
  along.low = along.x;
  if (missing > RESIDUAL_DEADBAND) {
    to->of.cells.joins =
        pursue(&along, &solve, here, missing > LONG_PATH_RESIDUAL ? along.cells : 0);
  } else {
    to->of.cells.joins = joins_at(&along, along.active, along.x);
  }
  return arrive(&along, words, to);
}

/* Results of a search on the segment of a candidate. */
enum { NOT_MET, MET, BEYOND };

/* Moves a candidate to the beginning of the next segment, unless a cell joins before; returns
   whether it did. */
static int step_segment(const entry *words, candidate *at)
{
  const int mirror = at->memory.cells.active < 0 ? -1 : 0;
  grid width = grid_at(at);
  const number end =
      unsafe_sum(begin_at(at, mirrored(at->memory.cells.x, mirror)), width_of(width));
  const int32_t next = (int32_t)at->of.cells.segment + 1;
  if (!(end <= at->of.cells.joins) || next <= integer_of(words[ANHYST_WORD_CELLS_ROWS]) ||
      next >= integer_of(words[ANHYST_WORD_LENGTH]) - 1) {
    return 0;
  }
  const unsigned bits = (unsigned)integer_of(words[ANHYST_WORD_CELLS_SEGMENTS]);
  const unsigned halvings = (unsigned)integer_of(words[ANHYST_WORD_CELLS_ZONE]);
  const number inner = POWER_OF_HALF(halvings);
  if (end == -inner) {
    width = grid_of(bits + halvings);
  } else if (end == inner) {
    width = grid_of(bits);
  }
  at->memory.cells.x = mirrored(end, mirror);
  describe(words, (int)next, end, width, mirrored(at->memory.cells.rest, mirror), at);
  return 1;
}

/* Moves a candidate to the target on its segment, not below the field where the step began or the
   last cell joined, and not beyond the field where the next cell joins. Sets h*x + m there, over 4.
   A target below by no more than rounding counts as met. BEYOND: the target is on one of the next
   segments. */
static inline int meet_on_segment(const entry *words, const arms_type *arms, number wanted,
                                  candidate *at, number *flux)
{
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  const int mirror = at->memory.cells.active < 0 ? -1 : 0;
  const number low = at->memory.cells.joined;
  const grid width = grid_at(at);
  const number begin = begin_at(at, mirrored(at->memory.cells.x, mirror));
  const number rise = rise_on(at, solve.air);
  const number whole = left_side(&solve, rise, width_of(width));
  const number missing =
      unsafe_difference(mirrored(wanted, mirror), left_side(&solve, at->of.cells.flux, begin));
  if (!(missing >= 0)) {
    return NOT_MET;
  }
  if (!(missing < whole)) {
    return quarter(missing) < whole ? BEYOND : NOT_MET;
  }
  const number part = ratio_part(missing, whole);
  number x = place_in(begin, width, part);
  if (x < low) {
    if (!is_rounding(low, x, width)) {
      return NOT_MET;
    }
    x = low;
  }
  at->memory.cells.x = mirrored(x, mirror);
  *flux = mirrored(unsafe_sum(at->of.cells.flux, rise_share(rise, part)), mirror);
  return is_flux(*flux) && x <= at->of.cells.joins ? MET : NOT_MET;
}

/* Solves from a candidate near the target, otherwise from the memory; returns h*x + m there,
   over 4. met: the result on the segment of the candidate. */
static number go_beyond(const entry *words, const cells_memory *from, const number *plays,
                        const arms_type *arms, number wanted, candidate *at, int met)
{
  number flux = 0;
  for (int more = MAX_SEGMENT_STEPS - 1; met == BEYOND && more > 0 && step_segment(words, at);
       more--) {
    met = meet_on_segment(words, arms, wanted, at, &flux);
  }
  return met == MET ? flux : travel(words, from, plays, arms, wanted, at);
}

/* Solves for a current without its bias, over 4, from a candidate if it is known; returns h*x + m
   there, over 4. */
static inline number reach_current(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number wanted,
                                   candidate *at, int is_known)
{
  number flux = 0;
  const int met =
      is_known && is_placed(at) ? meet_on_segment(words, arms, wanted, at, &flux) : NOT_MET;
  return met == MET ? flux : go_beyond(words, from, plays, arms, wanted, at, met);
}

/* Lets a path from the memory reverse there: no search on a segment goes back beyond it. */
static inline void begin_at_memory(compensator *c)
{
  candidate *at = &c->next;
  at->memory.cells.joined =
      inside(mirrored(c->memory.cells.x, at->memory.cells.active < 0 ? -1 : 0));
}

static number cells_flux(compensator *c, number current)
{
  if (c->stage == ANHYST_STAGE_HERE) { /* a commit without a solve */
    begin_at_memory(c);
  }
  return four_times(reach_current(c->words, &c->memory.cells, c->plays, &c->arms,
                                  quarter(current) - quarter(c->arms.bias), &c->next,
                                  c->stage != ANHYST_STAGE_UNKNOWN));
}

/* Solves for a flux that is not on the segment of the candidate. A flux that needs more current
   than a limit leads to this limit, where the commit of the limited current finds its candidate.
   Returns a field that is at the flux, or at the limit or beyond. */
static number field_beyond(compensator *c, int met)
{
  const arms_type *arms = &c->arms;
  const int rises = c->flux > c->flux_applied;
  const number limit =
      inner_limit(c->words, rises ? ANHYST_WORD_CURRENT_HIGH : ANHYST_WORD_CURRENT_LOW);
  const number least = arms->bias + scaled(c->flux, arms->flux_arm) +
                       scaled(inside(c->memory.cells.x), arms->field_arm);
  if (arms->flux_arm >= 0 && (rises ? least > limit : least < limit)) {
    (void)cells_flux(c, limit);
    return rises ? FIELD_MAX : FIELD_MIN;
  }
  (void)go_beyond(c->words, &c->memory.cells, c->plays, 0, quarter(c->flux), &c->next, met);
  return c->next.memory.cells.x;
}

static number cells_field(compensator *c)
{
  candidate *at = &c->next;
  number flux;
  int met = NOT_MET;
  begin_at_memory(c);
  if (c->stage == ANHYST_STAGE_HERE && is_placed(at)) {
    met = meet_on_segment(c->words, 0, quarter(c->flux), at, &flux);
  }
  return met == MET ? at->memory.cells.x : field_beyond(c, met);
}

static void cells_keep(compensator *c)
{
  if (have_turned(&c->memory.cells, &c->next.memory.cells)) {
    keep_plays(c->words, &c->memory.cells, c->plays);
  }
}

static void cells_carry(compensator *c, const entry *words, number flux)
{
  carry_memory(c->words, words, flux, &c->memory.cells, c->plays);
}

static void cells_start(compensator *c) { start_memory(c->words, c->plays, &c->memory.cells); }
