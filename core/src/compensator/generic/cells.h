/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law: play operators in the effective field, each with its own curve. Template for
   one number format; generic/cells_path.h is included before.

   The play p of cell i follows the field x within its threshold r. The cell contributes f(p), and m
   is the sum over all cells. On a rising path, the cells with the smallest thresholds move, all
   with p = x - r. A table row over x contains their sum T. The other cells are at rest and
   contribute a constant C:

     m = T(x) + C

   The next cell starts to move ("joins") where x reaches p + r. The algorithm follows a rising
   path; a falling path is mirrored. Rows are piecewise linear. Therefore, the equation

     flux_arm*(h*x + m) + field_arm*x = target

   has a closed-form solution on each segment. When a cell comes to rest, a row value is added to C.
   When the cell joins again, exactly the same value is subtracted, so that C does not drift. The
   solution is rounded against the direction of the path, so that a constant target never reverses
   the path. */

/* Maximum number of segments that a search from a trial step examines before a full solve. */
#define MAX_SEGMENT_STEPS 4

/* Residual, divided by 4, above which a path searches for all cells that came to rest together. */
#define LONG_PATH_RESIDUAL POWER_OF_HALF(6)

/* The equation to solve, divided by 4, in the direction of the path. */
typedef struct {
  entry air;
  const arms_type *arms; /* of a current; 0: solve h*x + m = target */
  number target;
} equation;

/* Returns h*x + m, divided by 4. Requires |x| <= 1. */
static inline number flux_at(const equation *eq, number x, number m)
{
  return quarter(m) + scaled(x, eq->air);
}

/* Returns the current of a flux and a field without its bias, divided by 4. */
static inline number current_without_bias(const arms_type *arms, number flux, number x)
{
  return scaled(flux, arms->flux_arm) + quarter(scaled(x, arms->field_arm));
}

static inline number left_side(const equation *eq, number flux, number x)
{
  return eq->arms == 0 ? flux : current_without_bias(eq->arms, flux, x);
}

/* Returns the target minus the left side at a field and a magnetisation. */
static inline number residual_at(const equation *eq, number x, number m)
{
  return eq->target - left_side(eq, flux_at(eq, x, m), x);
}

static number segment_field(const cell_path *path, int segment)
{
  const int from_centre = segment - path->zero_index;
  const int zone = path->zero_index - path->wide_segments;
  if (from_centre >= zone) {
    return segments_to_field(from_centre - path->wide_segments, path->wide_grid);
  }
  if (from_centre < -zone) {
    return segments_to_field(from_centre + path->wide_segments, path->wide_grid);
  }
  return segments_to_field(from_centre, path->zone_grid);
}

/* Returns the position of the solution on a segment (0..1), from the residual at its lower end. 0:
   at or below the lower end; WHOLE_SEGMENT: at or beyond the upper end. */
static inline number solve_segment(const equation *eq, const entry *segment, grid width,
                                   number residual)
{
  const number size = width_of(width);
  const number m = word_value(segment[1]) - word_value(segment[0]);
  const number rise = left_side(eq, flux_at(eq, size, m), size);
  if (residual >= rise) {
    return WHOLE_SEGMENT;
  }
  return residual > 0 ? divide_to_part(residual, rise) : 0;
}

/* Returns the field, at least low, where a cell joins the path. For a cell after the last one,
   returns the end of the rows. */
static number join_field(const cell_path *path, int cell, number low)
{
  if (cell > path->cells) {
    return FIELD_MAX;
  }
  const number at = saturate(sum(resting_play(path, cell), half_width(path, cell)));
  return at > low ? at : low;
}

/* Returns whether a cell came to rest on a path in this direction. */
static int has_rested_in_direction(const cell_path *path, int cell)
{
  const uint32_t risen = (uint32_t)path->risen ^ (uint32_t)(int32_t)path->mirror;
  return ((risen >> ((unsigned)cell & 31U)) & 1U) != 0U;
}

/* Sets the reversal point of the next cell as that of the path. All cells up to `last` that came to
   rest there on a path in the other direction belong to it. */
static void find_reversal_group(cell_path *path, int last)
{
  int cell = path->active;
  const number x = rest_field(path, cell);
  do {
    cell++;
  } while (cell <= last && !has_rested_in_direction(path, cell) && rest_field(path, cell) == x);
  path->reversal = locate(path, path->rows, mirrored(x, -1));
  path->x = x;
  path->prior_active = cell;
}

/* Returns the magnetisation of the next cell, which joins at this position, exactly as it was added
   to the sum of the cells at rest. */
static number resting_magnetisation(cell_path *path, spot position, int last)
{
  if (has_rested_in_direction(path, path->active)) {
    return cell_magnetisation(path, position);
  }
  if (path->active >= path->prior_active) {
    find_reversal_group(path, last);
  }
  const spot rest_position = {path->reversal.at + row_offset(path, path->active - 1),
                              path->reversal.part};
  return -cell_magnetisation(path, rest_position);
}

/* Solves the equation on the row of the moving cells, between low (on the segment of first_entry)
   and high. If the solution is after this segment, a bisection finds the last segment whose
   residual at the lower end is positive. */
static void solve_row(cell_path *path, const equation *eq, const entry *first_entry, number low,
                      number high)
{
  grid width = grid_at_field(path, low);
  number begin = segment_begin(low, width);
  number residual = residual_at(eq, begin, word_value(first_entry[0]) + path->rest);
  number part = solve_segment(eq, first_entry, width, residual);
  if (part >= WHOLE_SEGMENT) {
    int segment = (int)(first_entry - path->row);
    int end = (int)(locate(path, path->row, high).at - path->row);
    residual = FIELD_MAX;
    while (segment < end) {
      const int middle = (segment + end + 1) / 2;
      const number middle_field = segment_field(path, middle);
      const number residual_at_middle =
          residual_at(eq, middle_field, word_value(path->row[middle]) + path->rest);
      if (residual_at_middle <= 0) {
        end = middle - 1;
      } else {
        segment = middle;
        begin = middle_field;
        residual = residual_at_middle;
      }
    }
    first_entry = path->row + segment;
    width = grid_at_field(path, begin);
    part = solve_segment(eq, first_entry, width, residual);
  }
  path->segment = first_entry;
  path->x = clamped(field_at_part(begin, width, limit_part(part)), low, high);
}

/* Lets the cells that came to rest at the reversal of this path join again, up to the target. Finds
   their number by bisection. Returns the field where the last of them joins. */
static number rejoin_group(cell_path *path, const equation *eq, number low)
{
  const spot reversal_now = {path->reversal.at + row_offset(path, path->active - 1),
                             path->reversal.part};
  const number resting_before = path->rest;
  int min_cells = path->active;
  int max_cells = path->prior_active;
  while (min_cells < max_cells) {
    const int cells = (min_cells + max_cells + 1) / 2;
    const number next_field = join_field(path, cells - 1, low);
    const entry *row = row_of(path, cells);
    const number rest = saturate(
        resting_before + between(reversal_now, path->reversal.at + row_offset(path, cells - 1)));
    if (residual_at(eq, next_field, value_at(locate(path, row, next_field)) + rest) <= 0) {
      max_cells = cells - 1;
    } else {
      min_cells = cells;
      path->rest = rest;
      path->row = row;
      low = next_field;
    }
  }
  path->active = min_cells;
  return low;
}

/* Lets cells join up to the target of a path that starts at a position. Returns the segment of the
   last join, and sets path->last_join and the field of the next join. The search for cells that
   came to rest together covers cells up to `last`, and all cells after the first join. Short paths
   pass last = 0, because they end before the second join. */
static const entry *join_cells(cell_path *path, const equation *eq, spot position, int last,
                               number *next_join)
{
  number low = path->x;
  number next_field = join_field(path, path->active, low);
  int is_ended = 0;
  while (is_ended == 0 && path->active <= path->cells) {
    const spot next_position = locate(path, path->row, next_field);
    if (next_field > low &&
        residual_at(eq, next_field, value_at(next_position) + path->rest) <= 0) {
      break;
    }
    low = next_field;
    position = next_position;
    do { /* all cells that join at the same field */
      path->rest = saturate(path->rest - resting_magnetisation(path, position, last));
      path->active++;
      position.at += path->stride;
      next_field = join_field(path, path->active, low);
    } while (next_field == low && path->active <= path->cells);
    path->row = row_of(path, path->active);
    last = path->cells;
    if (path->active < path->prior_active) {
      low = rejoin_group(path, eq, low);
      position = locate(path, path->row, low);
      next_field = join_field(path, path->active, low);
      is_ended = path->active < path->prior_active; /* the next cell of the group joins after the
                                                       target */
    }
  }
  path->last_join = low;
  *next_join = next_field;
  return position.at;
}

/* Follows a path that starts below the target: lets cells join, and solves the equation. Returns
   the field where the next cell joins. */
static number follow_path(cell_path *path, const equation *eq, spot begin, int last)
{
  number next_join;
  const entry *first_entry = join_cells(path, eq, begin, last, &next_join);
  if (path->active > path->cells) {
    path->rest = 0; /* no cell is at rest */
  }
  solve_row(path, eq, first_entry, path->last_join, next_join);
  return next_join;
}

static void reverse_path(cell_path *path, spot position)
{
  const spot first = {position.at - row_offset(path, path->active - 1), position.part};
  const number moving_m = between(first, position.at);
  const uint32_t moving_mask = ((uint32_t)1 << (unsigned)path->active) - 1U;
  const uint32_t resting_mask = (uint32_t)path->risen & ~moving_mask;
  path->risen = (int32_t)(path->mirror == 0 ? resting_mask | moving_mask : resting_mask);
  path->rest = mirrored(saturate(path->rest + moving_m), -1);
  path->x = mirrored(path->x, -1);
  path->mirror = ~path->mirror;
  path->prior_active = path->active;
  path->reversal = first;
  path->active = 1;
  path->row = path->rows;
}

/* Stores the segment of a trial step, which starts at `begin`: its rise, and h*x + m at its lower
   end, divided by 4. */
static void describe_segment(const entry *words, int segment, number begin, grid width, number rest,
                             candidate *at)
{
  set_segment(at, words, segment, begin, width);
  at->of.cells.flux = quarter(unsafe_sum(word_value(words[segment]), rest)) +
                      scaled(begin, words[ANHYST_WORD_CELLS_AIR]);
}

/* Returns the rise of h*x + m on the segment of a trial step, divided by 4. */
static inline number flux_rise(const candidate *at, entry air)
{
  return quarter_rise(at) + scaled(width_of(candidate_grid(at)), air);
}

/* Stores the end of a path as a trial step. Returns h*x + m there, divided by 4. */
static number store_candidate(const cell_path *path, const entry *words, candidate *to)
{
  const grid width = grid_at_field(path, path->x);
  const number begin = segment_begin(path->x, width);
  to->memory.cells.x = mirrored(path->x, path->mirror);
  to->memory.cells.rest = mirrored(path->rest, path->mirror);
  to->memory.cells.active = path->mirror == 0 ? path->active : -path->active;
  to->memory.cells.risen = path->risen;
  to->memory.cells.joined = path->last_join;
  describe_segment(words, (int)(path->segment - words), begin, width, path->rest, to);
  const number rise = flux_rise(to, words[ANHYST_WORD_CELLS_AIR]);
  return mirrored(to->of.cells.flux + rise_at_part(rise, part_at(path->x, begin, width)),
                  path->mirror);
}

/* Solves from a memory. Returns h*x + m at the solution, divided by 4. The field does not change if
   the target is between the values of the rows for the two directions, which are not exactly
   odd. */
static number solve_from_memory(const entry *words, const cells_memory *from, const number *plays,
                                const arms_type *arms, number target, candidate *to)
{
  cell_path path;
  equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  begin_path(&path, words, from, plays);
  eq.target = mirrored(target, path.mirror);
  spot position = locate(&path, path.row, path.x);
  number residual = residual_at(&eq, path.x, value_at(position) + path.rest);
  path.segment = position.at;
  if (residual < -RESIDUAL_DEADBAND) {
    reverse_path(&path, position);
    eq.target = mirrored(eq.target, -1);
    position = locate(&path, path.row, path.x);
    residual = residual_at(&eq, path.x, value_at(position) + path.rest);
    if (residual <= RESIDUAL_DEADBAND) {
      begin_path(&path, words, from, plays);
    }
  }
  path.last_join = path.x;
  if (residual > RESIDUAL_DEADBAND) {
    to->of.cells.joins =
        follow_path(&path, &eq, position, residual > LONG_PATH_RESIDUAL ? path.cells : 0);
  } else {
    to->of.cells.joins = join_field(&path, path.active, path.x);
  }
  return store_candidate(&path, words, to);
}

/* Results of a search on the segment of a trial step. */
enum { NOT_SOLVED, SOLVED, BEYOND_SEGMENT };

/* Moves a trial step to the start of the next segment, unless a cell joins before. Returns whether
   it did. */
static int move_to_next_segment(const entry *words, candidate *at)
{
  const int mirror = at->memory.cells.active < 0 ? -1 : 0;
  grid width = candidate_grid(at);
  const number end =
      unsafe_sum(candidate_begin(at, mirrored(at->memory.cells.x, mirror)), width_of(width));
  const int32_t next = (int32_t)at->of.cells.segment + 1;
  if (!(end <= at->of.cells.joins) || next <= integer_of(words[ANHYST_WORD_CELLS_ROWS]) ||
      next >= integer_of(words[ANHYST_WORD_LENGTH]) - 1) {
    return 0;
  }
  const unsigned bits = (unsigned)integer_of(words[ANHYST_WORD_CELLS_SEGMENTS]);
  const unsigned halvings = (unsigned)integer_of(words[ANHYST_WORD_CELLS_ZONE]);
  const number inner = POWER_OF_HALF(halvings);
  if (end == -inner) {
    width = grid_from_halvings(bits + halvings);
  } else if (end == inner) {
    width = grid_from_halvings(bits);
  }
  at->memory.cells.x = mirrored(end, mirror);
  describe_segment(words, (int)next, end, width, mirrored(at->memory.cells.rest, mirror), at);
  return 1;
}

/* Moves a trial step to the target on its segment. The field stays at or above the field where the
   step started or the last cell joined, and at or below the field where the next cell joins. Sets
   h*x + m at the solution, divided by 4. A target that is lower only by rounding counts as solved.
   BEYOND_SEGMENT: the target is on one of the next segments. */
static inline int solve_on_segment(const entry *words, const arms_type *arms, number target,
                                   candidate *at, number *flux)
{
  const equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  const int mirror = at->memory.cells.active < 0 ? -1 : 0;
  const number low = at->memory.cells.joined;
  const grid width = candidate_grid(at);
  const number begin = candidate_begin(at, mirrored(at->memory.cells.x, mirror));
  const number rise = flux_rise(at, eq.air);
  const number full_rise = left_side(&eq, rise, width_of(width));
  const number residual =
      unsafe_difference(mirrored(target, mirror), left_side(&eq, at->of.cells.flux, begin));
  if (!(residual >= 0)) {
    return NOT_SOLVED;
  }
  if (!(residual < full_rise)) {
    return quarter(residual) < full_rise ? BEYOND_SEGMENT : NOT_SOLVED;
  }
  const number part = divide_to_part(residual, full_rise);
  number x = field_at_part(begin, width, part);
  if (x < low) {
    if (!is_rounding(low, x, width)) {
      return NOT_SOLVED;
    }
    x = low;
  }
  at->memory.cells.x = mirrored(x, mirror);
  *flux = mirrored(unsafe_sum(at->of.cells.flux, rise_at_part(rise, part)), mirror);
  return is_flux_valid(*flux) && x <= at->of.cells.joins ? SOLVED : NOT_SOLVED;
}

/* Solves from a trial step if the target is close, otherwise from the memory. Returns h*x + m at
   the solution, divided by 4. result: the outcome of the search on the segment of the trial
   step. */
static number solve_beyond_segment(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number target,
                                   candidate *at, int result)
{
  number flux = 0;
  for (int steps_left = MAX_SEGMENT_STEPS - 1;
       result == BEYOND_SEGMENT && steps_left > 0 && move_to_next_segment(words, at);
       steps_left--) {
    result = solve_on_segment(words, arms, target, at, &flux);
  }
  return result == SOLVED ? flux : solve_from_memory(words, from, plays, arms, target, at);
}

/* Solves for a current without its bias, divided by 4. Starts at the trial step if it is known.
   Returns h*x + m at the solution, divided by 4. */
static inline number solve_current(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number target,
                                   candidate *at, int is_known)
{
  number flux = 0;
  const int result =
      is_known && has_segment(at) ? solve_on_segment(words, arms, target, at, &flux) : NOT_SOLVED;
  return result == SOLVED ? flux
                          : solve_beyond_segment(words, from, plays, arms, target, at, result);
}

/* Allows a path from the memory to reverse there: no search on a segment goes below this field. */
static inline void start_at_memory(compensator *c)
{
  candidate *at = &c->next;
  at->memory.cells.joined =
      saturate(mirrored(c->memory.cells.x, at->memory.cells.active < 0 ? -1 : 0));
}

static number cells_flux(compensator *c, number current)
{
  if (c->stage == ANHYST_STAGE_HERE) { /* a commit without a solve */
    start_at_memory(c);
  }
  return four_times(solve_current(c->words, &c->memory.cells, c->plays, &c->arms,
                                  quarter(current) - quarter(c->arms.bias), &c->next,
                                  c->stage != ANHYST_STAGE_UNKNOWN));
}

/* Solves for a flux that is not on the segment of the trial step. If the flux needs more current
   than a limit, solves for this limit instead, because the commit of the limited current then
   starts at its solution. Returns a field at the flux, or at or beyond the limit. */
static number solve_field_beyond(compensator *c, int result)
{
  const arms_type *arms = &c->arms;
  const int rises = c->flux > c->flux_applied;
  const number limit =
      inner_limit(c->words, rises ? ANHYST_WORD_CURRENT_HIGH : ANHYST_WORD_CURRENT_LOW);
  const number least = arms->bias + scaled(c->flux, arms->flux_arm) +
                       scaled(saturate(c->memory.cells.x), arms->field_arm);
  if (arms->flux_arm >= 0 && (rises ? least > limit : least < limit)) {
    (void)cells_flux(c, limit);
    return rises ? FIELD_MAX : FIELD_MIN;
  }
  (void)solve_beyond_segment(c->words, &c->memory.cells, c->plays, 0, quarter(c->flux), &c->next,
                             result);
  return c->next.memory.cells.x;
}

static number cells_field(compensator *c)
{
  candidate *at = &c->next;
  number flux;
  int result = NOT_SOLVED;
  start_at_memory(c);
  if (c->stage == ANHYST_STAGE_HERE && has_segment(at)) {
    result = solve_on_segment(c->words, 0, quarter(c->flux), at, &flux);
  }
  return result == SOLVED ? at->memory.cells.x : solve_field_beyond(c, result);
}

static void cells_keep(compensator *c)
{
  if (have_reversed(&c->memory.cells, &c->next.memory.cells)) {
    store_plays(c->words, &c->memory.cells, c->plays);
  }
}

static void cells_carry(compensator *c, const entry *words, number flux)
{
  transfer_memory(c->words, words, flux, &c->memory.cells, c->plays);
}

static void cells_start(compensator *c) { start_memory(c->words, c->plays, &c->memory.cells); }
