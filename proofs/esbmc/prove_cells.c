/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the kernel of the play-cell law, function by function. The macro PART names the proved
   function. The functions that PART calls are replaced by their proved contracts (proofs.toml),
   which first show that the call is allowed. A loop whose number of iterations depends on data is
   proved for one iteration: proofs.toml inserts BEGIN_ITERATION and END_ITERATION, which show an
   invariant, forget everything except the invariant, and leave the loop. A path is any path that
   satisfies the invariant `is_path`, on rows of any size that anhyst_block_check accepts. The
   proofs assume that entries have the properties that this check guarantees. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#define ONE ANHYST_Q30_ONE
#define is_in_unit_range(a) ((a) >= -ONE && (a) < ONE)

#define BEGIN_ITERATION(invariant, forget, condition)                                              \
  SHOW(invariant);                                                                                 \
  forget;                                                                                          \
  ASSUME((invariant) && (condition));
#define END_ITERATION(invariant, forget)                                                           \
  SHOW(invariant);                                                                                 \
  forget;                                                                                          \
  ASSUME(invariant);                                                                               \
  break;

#define BISECTION_INVARIANT                                                                        \
  (segment >= 0 && segment <= end && end <= path->stride - 2 && is_in_unit_range(begin))
#define FORGET_BISECTION                                                                           \
  segment = nondet_i16();                                                                          \
  begin = nondet_i32();                                                                            \
  residual = any_within(-MAX_SHOWN_RESIDUAL, ANHYST_Q31_MAX);                                      \
  end = nondet_i16()

#define HALF_SCALE (ONE / 2)
/* Largest residual. */
#define MAX_SHOWN_RESIDUAL (ONE + HALF_SCALE / 2)

#include "compensator/cells.c"

static int16_t block_words[ANHYST_BLOCK_MOST_WORDS]; /* any */
static int32_t rested[ANHYST_CELLS];                 /* any plays */

/* Fills the words of a block that passed its check. */
static void any_block(int16_t *words)
{
  const int32_t bits = any_within(2, 8);
  const int32_t count = any_within(1, ANHYST_CELLS);
  words[ANHYST_WORD_CELLS_AIR] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  words[ANHYST_WORD_CELLS_COUNT] = (int16_t)count;
  words[ANHYST_WORD_CELLS_SEGMENTS] = (int16_t)bits;
  words[ANHYST_WORD_CELLS_ZONE] = (int16_t)any_within(0, bits < 5 ? bits : 5);
  words[ANHYST_WORD_CELLS_THRESHOLDS] = ANHYST_BLOCK_LEAST_WORDS;
  words[ANHYST_WORD_CELLS_ROWS] = ANHYST_BLOCK_LEAST_WORDS + ANHYST_CELLS;
  for (int16_t i = 0; i < ANHYST_CELLS; i++) {
    words[ANHYST_BLOCK_LEAST_WORDS + i] = (int16_t)any_within(1, ANHYST_Q15_MAX);
  }
  cell_path path;
  read_row_layout(&path, words);
  const int32_t end = words[ANHYST_WORD_CELLS_ROWS] + (count + 1) * path.stride;
  words[ANHYST_WORD_LENGTH] = (int16_t)any_within(end, ANHYST_BLOCK_MOST_WORDS);
  SHOW(path.stride >= 9 && path.wide_segments >= 0 && path.stride > 2 * path.wide_segments);
  SHOW(path.zone_grid >= 2 && path.wide_grid <= 13 && path.zone_grid <= path.wide_grid);
}

/* Positions on rows are indexes here, relative to the start of the first row. */
static int32_t index_on_rows(const cell_path *path, const int16_t *at)
{
  return (int32_t)(at - path->rows);
}

/* Returns whether a position is on a row, before its last entry. */
static int is_on_row(const cell_path *path, anhyst_table_position table_position, int32_t row)
{
  const int32_t segment = index_on_rows(path, table_position.segment) - row * path->stride;
  return segment >= 0 && segment <= path->stride - 2 && table_position.fraction >= 0 &&
         table_position.fraction <= 0x7FFF;
}

static int is_path(const cell_path *path)
{
  return path->active >= 1 && path->active <= path->cells + 1 && path->prior_active >= 0 &&
         path->prior_active <= path->cells + 1 && is_in_unit_range(path->x) &&
         is_in_unit_range(path->resting_m) && is_in_unit_range(path->last_activation) &&
         (path->mirror == 0 || path->mirror == -1) &&
         index_on_rows(path, path->row) == (path->active - 1) * path->stride &&
         is_on_row(path, path->reversal, 0);
}

/* Returns any position on a row that starts here. */
static anhyst_table_position any_row_position(const cell_path *path, const int16_t *row)
{
  const anhyst_table_position table_position = {row + any_within(0, path->stride - 2),
                                                any_within(0, 0x7FFF)};
  return table_position;
}

static cell_path any_path(void)
{
  cell_path path;
  any_block(block_words);
  read_row_layout(&path, block_words);
  for (int16_t i = 0; i < ANHYST_CELLS; i++) {
    rested[i] = nondet_i32();
  }
  path.plays = rested;
  path.active = (int16_t)any_within(1, path.cells + 1);
  path.prior_active = (int16_t)any_within(0, path.cells + 1);
  path.row = active_row(&path, path.active);
  path.reversal = any_row_position(&path, path.rows);
  path.stopped_on_rise = nondet_i32();
  path.resting_m = any_within(-ONE, ONE - 1);
  path.x = any_within(-ONE, ONE - 1);
  path.last_activation = any_within(-ONE, ONE - 1);
  path.mirror = nondet_i16() != 0 ? -1 : 0;
  path.segment = path.row;
  SHOW(is_path(&path));
  return path;
}

/* Largest target of a current or a flux, divided by 4. */
#define MAX_TARGET (HALF_SCALE + HALF_SCALE / 4)

static anhyst_arms any_arms(void)
{
  const anhyst_arms arms = {any_within(-HALF_SCALE, HALF_SCALE),
                            (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  return arms;
}

static int is_target(const equation *eq)
{
  const int32_t most = eq->arms == 0 ? HALF_SCALE / 2 + 1 : MAX_TARGET;
  return eq->target >= -most && eq->target <= most;
}

static equation any_equation(const anhyst_arms *arms)
{
  const equation eq = {(int16_t)any_within(1, ANHYST_Q15_MAX), nondet_i16() != 0 ? arms : 0,
                       nondet_i32()};
  ASSUME(is_target(&eq));
  return eq;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline int32_t anhyst_table_value(anhyst_table_position table_position)
{
  SHOW(table_position.fraction >= 0 && table_position.fraction <= 0x7FFF);
  return any_within(-ANHYST_Q15_MAX * 32768, ANHYST_Q15_MAX * 32768);
}

static inline number row_difference(table_position position, const entry *other)
{
  SHOW(position.fraction >= 0 && position.fraction <= 0x7FFF);
  return any_within(-ANHYST_Q15_MAX * 32768, ANHYST_Q15_MAX * 32768);
}
#endif

#ifdef SPOT_BY_CONTRACT
static inline table_position locate_field(const cell_path *path, const entry *row, number x)
{
  SHOW(is_in_unit_range(x));
  SHOW(index_on_rows(path, row) >= 0 && index_on_rows(path, row) <= path->cells * path->stride);
  return any_row_position(path, row);
}
#endif

#ifdef RESIDUAL_BY_CONTRACT
static inline number residual_at(const equation *eq, number x, number m)
{
  (void)m;
  SHOW(is_in_unit_range(x) && is_target(eq));
  return any_within(-MAX_SHOWN_RESIDUAL, MAX_SHOWN_RESIDUAL);
}

static inline number solve_segment(const equation *eq, const entry *segment, segment_grid width,
                                   number residual)
{
  (void)segment;
  SHOW(residual >= -MAX_SHOWN_RESIDUAL && is_target(eq));
  SHOW(width >= 2U && width <= 13U);
  return any_within(0, 0x8000);
}
#endif

#ifdef PART_BY_CONTRACT
static inline number divide_to_fraction(number residual, number rise)
{
  SHOW(residual >= 0 && residual < rise);
  return any_within(0, 0x7FFF);
}
#endif

#ifdef NODE_BY_CONTRACT
static number field_at_segment(const cell_path *path, int segment)
{
  SHOW(segment >= 0 && segment <= path->stride - 2);
  return any_within(-ONE, ONE - 1);
}
#endif

static int is_candidate(const anhyst_candidate *at);

#ifdef TRAVEL_BY_CONTRACT
static number solve_from_state(const entry *words, const cells_memory *from, const number *plays,
                               const arms_type *arms, number target, candidate *to)
{
  const equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  SHOW(is_target(&eq));
  ASSUME(is_candidate(to));
  return any_within(-ONE, ONE);
}
#endif

#ifdef SEGMENT_BY_CONTRACT
static inline int solve_on_segment(const entry *words, const arms_type *arms, number target,
                                   candidate *at, number *flux)
{
  const equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  SHOW(is_target(&eq) && is_in_unit_range(at->memory.cells.last_activation));
  at->memory.cells.x = any_within(-ONE, ONE - 1);
  *flux = nondet_i32();
  return any_within(NOT_SOLVED, BEYOND_SEGMENT);
}

static number solve_beyond_segment(const entry *words, const cells_memory *from,
                                   const number *plays, const arms_type *arms, number target,
                                   candidate *at, int result)
{
  const equation eq = {words[ANHYST_WORD_CELLS_AIR], arms, target};
  SHOW(is_target(&eq) && result != SOLVED);
  return nondet_i32();
}
#endif

#ifdef DESCRIBE_BY_CONTRACT
static void store_segment(const entry *words, int segment, number begin, segment_grid width,
                          number rest, candidate *at)
{
  cell_path path;
  read_row_layout(&path, words);
  SHOW(is_in_unit_range(begin) && is_in_unit_range(rest) && width >= 2U && width <= 13U);
  SHOW(segment >= words[ANHYST_WORD_CELLS_ROWS]);
  SHOW(segment <= words[ANHYST_WORD_CELLS_ROWS] + (path.cells + 1) * path.stride - 2);
  at->of.cells.segment = (int16_t)segment;
  at->of.cells.log2_width = (uint16_t)width;
  at->of.cells.row_rise = (int16_t)any_within(0, ANHYST_Q15_MAX);
  at->of.cells.flux = any_within(-ONE, ONE);
}
#endif

/* ---- proofs ---- */

/* Proves the position of a field on a row of any size, and the way back from a position. */
static void prove_rows(void)
{
  const cell_path path = any_path();
  const int32_t x = any_within(-ONE, ONE - 1);
  const anhyst_table_position table_position = locate_field(&path, path.row, x);
  SHOW(is_on_row(&path, table_position, path.active - 1));
  const segment_grid width = grid_at_field(&path, x);
  const int32_t begin = segment_begin(x, width);
  SHOW(is_in_unit_range(begin) && begin <= x && x - begin < width_of(width));
  SHOW(begin + width_of(width) <= ONE && fraction_at(x, begin, width) == table_position.fraction);
  const int16_t segment = (int16_t)any_within(0, path.stride - 2);
  SHOW(is_in_unit_range(field_at_segment(&path, segment)));
}

static void prove_divide_to_part(void)
{
  const int32_t d = any_within(1, ANHYST_Q31_MAX);
  const int32_t found = divide_to_fraction(any_within(0, d - 1), d);
  SHOW(found >= 0 && found <= 0x7FFF);
}

static void prove_residual(void)
{
  const cell_path path = any_path();
  const anhyst_arms arms = any_arms();
  const equation eq = any_equation(&arms);
  const int32_t x = any_within(-ONE, ONE - 1);
  const anhyst_table_position table_position = any_row_position(&path, path.row);
  ASSUME(table_position.segment[1] >= table_position.segment[0] &&
         table_position.segment[1] - table_position.segment[0] <= ANHYST_Q15_MAX);
  const int32_t residual = residual_at(&eq, x, row_value(table_position) + path.resting_m);
  SHOW(residual >= -MAX_SHOWN_RESIDUAL && residual <= MAX_SHOWN_RESIDUAL);
  const int32_t left = any_within(-MAX_SHOWN_RESIDUAL, ANHYST_Q31_MAX);
  const int32_t part = solve_segment(&eq, table_position.segment, grid_at_field(&path, x), left);
  SHOW(part >= 0 && part <= 0x8000);
}

static void prove_join_field(void)
{
  cell_path path = any_path();
  const int32_t low = any_within(-ONE, ONE - 1);
  const int16_t cell = (int16_t)any_within(1, path.cells + 1);
  const int32_t at = activation_field(&path, cell, low);
  SHOW(at >= low && at < ONE);
  ASSUME(cell <= path.cells);
  path.active = cell;
  path.row = active_row(&path, cell);
  const int32_t with = resting_magnetisation(&path, any_row_position(&path, path.row), path.cells);
  SHOW(with > -ONE && with < ONE);
}

static void prove_find_reversal_group(void)
{
  cell_path path = any_path();
  ASSUME(path.active <= path.cells);
  const int16_t active = path.active;
  find_reversal_group(&path, (int16_t)any_within(0, path.cells));
  SHOW(is_path(&path) && path.prior_active > active && path.active == active);
}

static void prove_rejoin_group(void)
{
  cell_path path = any_path();
  const anhyst_arms arms = any_arms();
  const equation eq = any_equation(&arms);
  const int32_t low = any_within(-ONE, ONE - 1);
  ASSUME(path.active < path.prior_active);
  const int32_t last = reactivate_group(&path, &eq, low);
  SHOW(is_path(&path) && is_in_unit_range(last));
}

static void prove_reverse_path(void)
{
  cell_path path = any_path();
  reverse_path(&path, any_row_position(&path, path.row));
  SHOW(is_path(&path) && path.active == 1);
}

static void prove_solve_row(void)
{
  cell_path path = any_path();
  const anhyst_arms arms = any_arms();
  const equation eq = any_equation(&arms);
  const int32_t low = any_within(-ONE, ONE - 1);
  const int32_t high = any_within(low, ONE - 1);
  solve_row(&path, &eq, any_row_position(&path, path.row).segment, low, high);
  SHOW(is_path(&path) && path.x >= low && path.x <= high);
}

static int is_memory(const anhyst_cells_memory *to)
{
  return is_in_unit_range(to->x) && is_in_unit_range(to->resting_m) &&
         to->active >= -ANHYST_CELLS - 1 && to->active <= ANHYST_CELLS + 1;
}

static anhyst_cells_memory any_memory(void)
{
  const anhyst_cells_memory any = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                   nondet_i32()};
  return any;
}

/* Returns whether a trial step has the properties that a search assumes. */
static int is_candidate(const anhyst_candidate *at)
{
  return is_memory(&at->memory.cells) && is_in_unit_range(at->of.cells.next_activation) &&
         at->of.cells.flux >= -ONE && at->of.cells.flux <= ONE && at->of.cells.row_rise >= 0 &&
         at->of.cells.log2_width >= 2U && at->of.cells.log2_width <= 13U;
}

/* Proves a trial step with a known segment, anywhere on a path. */
static void prove_solve_on_segment(void)
{
  const cell_path path = any_path();
  const anhyst_arms arms = any_arms();
  const equation eq = any_equation(&arms);
  anhyst_compensator c;
  const anhyst_cells_memory memory = {mirrored(path.x, path.mirror),
                                      mirrored(path.resting_m, path.mirror),
                                      path.mirror == 0 ? path.active : -path.active,
                                      path.stopped_on_rise, any_within(-ONE, ONE - 1)};
  anhyst_candidate *at = &c.next;
  c.words = block_words;
  at->memory.cells = memory;
  at->of.cells.next_activation = any_within(path.x, ONE - 1);
  at->of.cells.flux = any_within(-ONE, ONE);
  at->of.cells.segment = (int16_t)(locate_field(&path, path.row, path.x).segment - block_words);
  at->of.cells.row_rise = (int16_t)any_within(0, ANHYST_Q15_MAX);
  at->of.cells.log2_width = (uint16_t)grid_at_field(&path, path.x);
  int32_t flux = 0;
  const int result = solve_on_segment(block_words, eq.arms, eq.target, at, &flux);
  if (result != SOLVED) {
    (void)solve_beyond_segment(block_words, &c.memory.cells, c.plays, eq.arms, eq.target, at,
                               result);
  }
  SHOW(is_candidate(at));
}

/* Proves the kernel for any memory, flux, current and limits. */
static void prove_field(void)
{
  anhyst_compensator c;
  any_block(block_words);
  ASSUME(block_words[ANHYST_WORD_CURRENT_SHIFT] >= 0 &&
         block_words[ANHYST_WORD_CURRENT_SHIFT] <= 8);
  c.words = block_words;
  c.arms = any_arms();
  c.flux = any_within(-ONE, ONE);
  c.stage = (uint16_t)any_within(ANHYST_STAGE_UNKNOWN, ANHYST_STAGE_HERE);
  (void)cells_field_for_flux(&c);
  (void)cells_flux_for_current(&c, nondet_i32());
}

static void prove_store_plays(void)
{
  (void)any_path();
  const anhyst_cells_memory from = any_memory();
  store_active_plays(block_words, &from, rested);
}

int main(void)
{
  PART();
  return 0;
}
