/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law: a sum of play operators in the effective field, each with its own
   magnetisation curve. Template for one number format; generic/cells_path.h is included before.

   The play p of cell i follows the field x within its threshold r. The cell contributes f(p), and m
   is the sum over all cells. While the field rises, the cells with the smallest thresholds are
   active: each of them has p = x - r. A table row contains the sum T of the active cells as a
   function of x. The other cells are at rest and contribute a constant C:

     m = T(x) + C

   The next cell becomes active where x reaches p + r. The algorithm follows a path with rising
   field. A path with falling field is mirrored. Table rows are piecewise linear. Therefore, the
   equation

     flux_arm*(h*x + m) + field_arm*x = target

   has a closed-form solution on each segment. When a cell comes to rest, a table value is added to
   C. When the cell becomes active again, exactly the same value is subtracted, so that C does not
   drift. The solution is rounded against the direction of the path, so that a constant target never
   reverses the path. */

/* Maximum number of segments that are searched from a trial step before a full solve. */
#define MAX_SEGMENT_STEPS 4

/* Residual, divided by 4, above which the search includes all cells that came to rest together. */
#define GROUP_SEARCH_RESIDUAL POWER_OF_HALF(6)

/* Equation for the field, divided by 4, in the direction of the path. */
typedef struct {
  entry air;
  const arms_type *arms; /* coefficients of a current; 0: solve h*x + m = target */
  number target;
} equation;

/* Returns the flux h*x + m, divided by 4. Requires |x| <= 1. */
static inline number flux_at(const equation *eq, number x, number m)
{
  return quarter(m) + scaled(x, eq->air);
}

/* Returns the current of a flux and a field, without its bias, divided by 4. */
static inline number current_without_bias(const arms_type *arms, number flux, number x)
{
  return scaled(flux, arms->flux_arm) + quarter(scaled(x, arms->field_arm));
}

static inline number left_side(const equation *eq, number flux, number x)
{
  return eq->arms == 0 ? flux : current_without_bias(eq->arms, flux, x);
}

/* Returns the target minus the left side of the equation at a field and a magnetisation. */
static inline number residual_at(const equation *eq, number x, number m)
{
  return eq->target - left_side(eq, flux_at(eq, x, m), x);
}

static number field_at_segment(const cell_path *path, int segment)
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

/* Returns the position of the solution on a segment as a fraction, from the residual at the lower
   end of the segment. Returns 0 for a solution at or below the lower end, and WHOLE_SEGMENT for a
   solution at or beyond the upper end. */
static inline number solve_segment(const equation *eq, const entry *segment, segment_grid width,
                                   number residual)
{
  const number size = width_of(width);
  const number m = word_value(segment[1]) - word_value(segment[0]);
  const number rise = left_side(eq, flux_at(eq, size, m), size);
  if (residual >= rise) {
    return WHOLE_SEGMENT;
  }
  return residual > 0 ? divide_to_fraction(residual, rise) : 0;
}

/* Returns the field, at least `low`, at which a cell becomes active. After the last cell, returns
   the largest field. */
static number activation_field(const cell_path *path, int cell, number low)
{
  if (cell > path->cells) {
    return MAX_FIELD;
  }
  const number field = saturate(sum(resting_play(path, cell), half_width(path, cell)));
  return field > low ? field : low;
}

/* Returns whether a cell came to rest while the field moved in the direction of this path. */
static int has_same_stop_direction(const cell_path *path, int cell)
{
  const uint32_t mask = (uint32_t)path->stopped_on_rise ^ (uint32_t)(int32_t)path->mirror;
  return ((mask >> ((unsigned)cell & 31U)) & 1U) != 0U;
}

/* Finds all cells up to last_cell that came to rest together with the next cell, while the field
   moved in the other direction. Sets the reversal point of the path to that of these cells. */
static void find_reversal_group(cell_path *path, int last_cell)
{
  int cell = path->active;
  const number x = stopping_field(path, cell);
  do {
    cell++;
  } while (cell <= last_cell && !has_same_stop_direction(path, cell) &&
           stopping_field(path, cell) == x);
  path->reversal = locate_field(path, path->rows, mirrored(x, -1));
  path->x = x;
  path->prior_active = cell;
}

/* Returns the magnetisation of the next cell, which becomes active at this position: exactly the
   value that was added to the sum of the cells at rest. */
static number resting_magnetisation(cell_path *path, table_position position, int last_cell)
{
  if (has_same_stop_direction(path, path->active)) {
    return cell_magnetisation(path, position);
  }
  if (path->active >= path->prior_active) {
    find_reversal_group(path, last_cell);
  }
  const table_position rest_position = {path->reversal.segment + row_offset(path, path->active - 1),
                                        path->reversal.fraction};
  return -cell_magnetisation(path, rest_position);
}

/* Solves the equation in the row of the active cells, between the fields `low` (on the segment of
   first_entry) and `high`. If the solution is after this segment, a bisection finds the last
   segment whose residual at the lower end is positive. */
static void solve_row(cell_path *path, const equation *eq, const entry *first_entry, number low,
                      number high)
{
  segment_grid width = grid_at_field(path, low);
  number begin = segment_begin(low, width);
  number residual = residual_at(eq, begin, word_value(first_entry[0]) + path->resting_m);
  number fraction = solve_segment(eq, first_entry, width, residual);
  if (fraction >= WHOLE_SEGMENT) {
    int segment = (int)(first_entry - path->row);
    int end = (int)(locate_field(path, path->row, high).segment - path->row);
    residual = MAX_FIELD;
    while (segment < end) {
      const int middle = (segment + end + 1) / 2;
      const number middle_field = field_at_segment(path, middle);
      const number residual_at_middle =
          residual_at(eq, middle_field, word_value(path->row[middle]) + path->resting_m);
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
    fraction = solve_segment(eq, first_entry, width, residual);
  }
  path->segment = first_entry;
  path->x = clamped(field_at_fraction(begin, width, limit_fraction(fraction)), low, high);
}

/* Activates cells that came to rest together at the reversal of this path, up to the target. A
   bisection finds the number of cells. Returns the field at which the last cell becomes active. */
static number reactivate_group(cell_path *path, const equation *eq, number low)
{
  const table_position reversal = {path->reversal.segment + row_offset(path, path->active - 1),
                                   path->reversal.fraction};
  const number start_m = path->resting_m;
  int min_cells = path->active;
  int max_cells = path->prior_active;
  while (min_cells < max_cells) {
    const int cells = (min_cells + max_cells + 1) / 2;
    const number next_field = activation_field(path, cells - 1, low);
    const entry *row = active_row(path, cells);
    const number rest_m = saturate(
        start_m + row_difference(reversal, path->reversal.segment + row_offset(path, cells - 1)));
    if (residual_at(eq, next_field, row_value(locate_field(path, row, next_field)) + rest_m) <= 0) {
      max_cells = cells - 1;
    } else {
      min_cells = cells;
      path->resting_m = rest_m;
      path->row = row;
      low = next_field;
    }
  }
  path->active = min_cells;
  return low;
}

/* Activates cells along a path from a position up to the target. Sets path->last_activation, and
   the field at which the next cell becomes active. Returns the segment of path->last_activation.
   The search for cells that came to rest together ends at last_cell, and after the first activation
   at the last cell. For short paths, which end before the second activation, last_cell is 0. */
static const entry *activate_cells(cell_path *path, const equation *eq, table_position position,
                                   int last_cell, number *next_activation)
{
  number low = path->x;
  number next_field = activation_field(path, path->active, low);
  int is_ended = 0;
  while (is_ended == 0 && path->active <= path->cells) {
    const table_position next_position = locate_field(path, path->row, next_field);
    if (next_field > low &&
        residual_at(eq, next_field, row_value(next_position) + path->resting_m) <= 0) {
      break;
    }
    low = next_field;
    position = next_position;
    do { /* all cells that become active at the same field */
      path->resting_m =
          saturate(path->resting_m - resting_magnetisation(path, position, last_cell));
      path->active++;
      position.segment += path->stride;
      next_field = activation_field(path, path->active, low);
    } while (next_field == low && path->active <= path->cells);
    path->row = active_row(path, path->active);
    last_cell = path->cells;
    if (path->active < path->prior_active) {
      low = reactivate_group(path, eq, low);
      position = locate_field(path, path->row, low);
      next_field = activation_field(path, path->active, low);
      is_ended = path->active < path->prior_active; /* the next cell is after the target */
    }
  }
  path->last_activation = low;
  *next_activation = next_field;
  return position.segment;
}

/* Solves the equation along a path that starts below the target, and activates cells on the way.
   Returns the field at which the next cell becomes active. */
static number solve_path(cell_path *path, const equation *eq, table_position begin, int last_cell)
{
  number next_activation;
  const entry *first_entry = activate_cells(path, eq, begin, last_cell, &next_activation);
  if (path->active > path->cells) {
    path->resting_m = 0; /* no cell is at rest */
  }
  solve_row(path, eq, first_entry, path->last_activation, next_activation);
  return next_activation;
}

static void reverse_path(cell_path *path, table_position position)
{
  const table_position first_position = {position.segment - row_offset(path, path->active - 1),
                                         position.fraction};
  const number active_m = row_difference(first_position, position.segment);
  const uint32_t active_mask = ((uint32_t)1 << (unsigned)path->active) - 1U;
  const uint32_t resting_mask = (uint32_t)path->stopped_on_rise & ~active_mask;
  path->stopped_on_rise = (int32_t)(path->mirror == 0 ? resting_mask | active_mask : resting_mask);
  path->resting_m = mirrored(saturate(path->resting_m + active_m), -1);
  path->x = mirrored(path->x, -1);
  path->mirror = ~path->mirror;
  path->prior_active = path->active;
  path->reversal = first_position;
  path->active = 1;
  path->row = path->rows;
}

/* Stores the segment of a trial step that starts at the field `begin`: the rise of the segment, and
   the flux h*x + m at `begin`, divided by 4. */
static void store_segment(const entry *words, int segment, number begin, segment_grid width,
                          number resting_m, candidate *trial)
{
  set_segment(trial, words, segment, begin, width);
  trial->of.cells.flux = quarter(unsafe_sum(word_value(words[segment]), resting_m)) +
                         scaled(begin, words[ANHYST_WORD_CELLS_AIR]);
}

/* Returns the rise of h*x + m over the segment of a trial step, divided by 4. */
static inline number segment_flux_rise(const candidate *trial, entry air)
{
  return quarter_rise(trial) + scaled(width_of(trial_grid(trial)), air);
}

/* Stores the end of a path as a trial step. Returns the flux h*x + m of this step, divided by 4. */
static number store_trial(const cell_path *path, const entry *words, candidate *trial)
{
  const segment_grid width = grid_at_field(path, path->x);
  const number begin = segment_begin(path->x, width);
  trial->memory.cells.x = mirrored(path->x, path->mirror);
  trial->memory.cells.resting_m = mirrored(path->resting_m, path->mirror);
  trial->memory.cells.active = path->mirror == 0 ? path->active : -path->active;
  trial->memory.cells.stopped_on_rise = path->stopped_on_rise;
  trial->memory.cells.last_activation = path->last_activation;
  store_segment(words, (int)(path->segment - words), begin, width, path->resting_m, trial);
  const number rise = segment_flux_rise(trial, words[ANHYST_WORD_CELLS_AIR]);
  return mirrored(trial->of.cells.flux + multiply_rise(rise, fraction_at(path->x, begin, width)),
                  path->mirror);
}

/* Solves from a stored state. Returns the flux h*x + m of the solution, divided by 4. Rows for
   rising and falling field are not exactly odd: a target between them does not change the field. */
static number solve_from_state(const entry *words, const cells_memory *from, const number *plays,
                               const arms_type *arms, number target, candidate *trial)
{
  cell_path path;
  equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  begin_path(&path, words, from, plays);
  eq.target = mirrored(target, path.mirror);
  table_position position = locate_field(&path, path.row, path.x);
  number residual = residual_at(&eq, path.x, row_value(position) + path.resting_m);
  path.segment = position.segment;
  if (residual < -RESIDUAL_DEADBAND) {
    reverse_path(&path, position);
    eq.target = mirrored(eq.target, -1);
    position = locate_field(&path, path.row, path.x);
    residual = residual_at(&eq, path.x, row_value(position) + path.resting_m);
    if (residual <= RESIDUAL_DEADBAND) {
      begin_path(&path, words, from, plays);
    }
  }
  path.last_activation = path.x;
  if (residual > RESIDUAL_DEADBAND) {
    trial->of.cells.next_activation =
        solve_path(&path, &eq, position, residual > GROUP_SEARCH_RESIDUAL ? path.cells : 0);
  } else {
    trial->of.cells.next_activation = activation_field(&path, path.active, path.x);
  }
  return store_trial(&path, words, trial);
}

/* Results of a search on the segment of a trial step. */
enum { NOT_SOLVED, SOLVED, BEYOND_SEGMENT };

/* Moves a trial step to the start of the next segment. Returns 0 if a cell becomes active before
   the next segment, or if there is no next segment. */
static int move_to_next_segment(const entry *words, candidate *trial)
{
  const int mirror = trial->memory.cells.active < 0 ? -1 : 0;
  segment_grid width = trial_grid(trial);
  const number end =
      unsafe_sum(trial_lower_end(trial, mirrored(trial->memory.cells.x, mirror)), width_of(width));
  const int32_t next = (int32_t)trial->of.cells.segment + 1;
  if (!(end <= trial->of.cells.next_activation) ||
      next <= integer_of(words[ANHYST_WORD_CELLS_ROWS]) ||
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
  trial->memory.cells.x = mirrored(end, mirror);
  store_segment(words, (int)next, end, width, mirrored(trial->memory.cells.resting_m, mirror),
                trial);
  return 1;
}

/* Moves a trial step to the target on its segment. The field stays at or above the field where the
   step started or the last cell became active, and at or below the field where the next cell
   becomes active. Stores the flux h*x + m of the solution, divided by 4, in *flux. A target that is
   lower only by rounding counts as solved. BEYOND_SEGMENT: the target is on a later segment. */
static inline int solve_on_segment(const entry *words, const arms_type *arms, number target,
                                   candidate *trial, number *flux)
{
  const equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  const int mirror = trial->memory.cells.active < 0 ? -1 : 0;
  const number low = trial->memory.cells.last_activation;
  const segment_grid width = trial_grid(trial);
  const number begin = trial_lower_end(trial, mirrored(trial->memory.cells.x, mirror));
  const number rise = segment_flux_rise(trial, eq.air);
  const number full_rise = left_side(&eq, rise, width_of(width));
  const number residual =
      unsafe_difference(mirrored(target, mirror), left_side(&eq, trial->of.cells.flux, begin));
  if (!(residual >= 0)) {
    return NOT_SOLVED;
  }
  if (!(residual < full_rise)) {
    return quarter(residual) < full_rise ? BEYOND_SEGMENT : NOT_SOLVED;
  }
  const number fraction = divide_to_fraction(residual, full_rise);
  number x = field_at_fraction(begin, width, fraction);
  if (x < low) {
    if (!is_rounding_error(low, x, width)) {
      return NOT_SOLVED;
    }
    x = low;
  }
  trial->memory.cells.x = mirrored(x, mirror);
  *flux = mirrored(unsafe_sum(trial->of.cells.flux, multiply_rise(rise, fraction)), mirror);
  return is_flux_valid(*flux) && x <= trial->of.cells.next_activation ? SOLVED : NOT_SOLVED;
}

/* Solves from a trial step if the target is close, otherwise from the stored state. The argument
   `result` is the outcome of the search on the segment. Returns the flux h*x + m, divided by 4. */
static number solve_beyond_segment(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number target,
                                   candidate *trial, int result)
{
  number flux = 0;
  for (int steps_left = MAX_SEGMENT_STEPS - 1;
       result == BEYOND_SEGMENT && steps_left > 0 && move_to_next_segment(words, trial);
       steps_left--) {
    result = solve_on_segment(words, arms, target, trial, &flux);
  }
  return result == SOLVED ? flux : solve_from_state(words, from, plays, arms, target, trial);
}

/* Solves for a current without its bias, divided by 4. If the trial step is known, the search
   starts there. Returns the flux h*x + m of the solution, divided by 4. */
static inline number solve_current(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number target,
                                   candidate *trial, int is_known)
{
  number flux = 0;
  const int result = is_known && has_segment(trial)
                         ? solve_on_segment(words, arms, target, trial, &flux)
                         : NOT_SOLVED;
  return result == SOLVED ? flux
                          : solve_beyond_segment(words, from, plays, arms, target, trial, result);
}

/* Allows a reversal at the stored state: no search on a segment goes below this state's field. */
static inline void allow_reversal(compensator *c)
{
  candidate *trial = &c->next;
  trial->memory.cells.last_activation =
      saturate(mirrored(c->memory.cells.x, trial->memory.cells.active < 0 ? -1 : 0));
}

static number cells_flux_for_current(compensator *c, number current)
{
  if (c->stage == ANHYST_STAGE_HERE) { /* a commit without a solve before it */
    allow_reversal(c);
  }
  return four_times(solve_current(c->words, &c->memory.cells, c->plays, &c->arms,
                                  quarter(current) - quarter(c->arms.bias), &c->next,
                                  c->stage != ANHYST_STAGE_UNKNOWN));
}

/* Solves for a flux that is not on the segment of the trial step, and returns the field. If the
   flux needs more current than a limit, solves for the limit instead, and returns the largest or
   smallest field. The commit of the limited current then starts at the solution for the limit. */
static number solve_field_beyond_segment(compensator *c, int result)
{
  const arms_type *arms = &c->arms;
  const int rises = c->flux > c->flux_applied;
  const number limit =
      internal_current_limit(c->words, rises ? ANHYST_WORD_CURRENT_HIGH : ANHYST_WORD_CURRENT_LOW);
  const number min_current = arms->bias + scaled(c->flux, arms->flux_arm) +
                             scaled(saturate(c->memory.cells.x), arms->field_arm);
  if (arms->flux_arm >= 0 && (rises ? min_current > limit : min_current < limit)) {
    (void)cells_flux_for_current(c, limit);
    return rises ? MAX_FIELD : MIN_FIELD;
  }
  (void)solve_beyond_segment(c->words, &c->memory.cells, c->plays, 0, quarter(c->flux), &c->next,
                             result);
  return c->next.memory.cells.x;
}

static number cells_field_for_flux(compensator *c)
{
  candidate *trial = &c->next;
  number flux;
  int result = NOT_SOLVED;
  allow_reversal(c);
  if (c->stage == ANHYST_STAGE_HERE && has_segment(trial)) {
    result = solve_on_segment(c->words, 0, quarter(c->flux), trial, &flux);
  }
  return result == SOLVED ? trial->memory.cells.x : solve_field_beyond_segment(c, result);
}

static void cells_store_plays(compensator *c)
{
  if (have_reversed(&c->memory.cells, &c->next.memory.cells)) {
    store_active_plays(c->words, &c->memory.cells, c->plays);
  }
}

static void cells_transfer_state(compensator *c, const entry *words, number flux)
{
  transfer_state(c->words, words, flux, &c->memory.cells, c->plays);
}

static void cells_init_state(compensator *c) { init_cells(c->words, c->plays, &c->memory.cells); }
