/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of the law of cells, function by function. PART names the one
   that is proved; those below it are replaced by what their own proof has shown
   (contracts in proofs.toml), each of them first showing that it may be called so.

   A loop that turns as often as its data say is proved for one turn: proofs.toml puts BEGIN_TURN
   and END_TURN into its body, which show an invariant, forget everything but that, and leave the
   loop.

   A path is any that the invariant `is_path` allows, on rows of any size that anhyst_block_check
   lets through; where a row is read, what the check says of its entries is assumed. */
#define ANHYST_PORT_HEADER "contracts.h"
#include "any.h"

#define ONE ANHYST_Q30_ONE
#define is_inside(a) ((a) >= -ONE && (a) < ONE)

#define BEGIN_TURN(invariant, forget, condition)                                                   \
  SHOW(invariant);                                                                                 \
  forget;                                                                                          \
  ASSUME((invariant) && (condition));
#define END_TURN(invariant, forget)                                                                \
  SHOW(invariant);                                                                                 \
  forget;                                                                                          \
  ASSUME(invariant);                                                                               \
  break;

#define HALVING (segment >= 0 && segment <= end && end <= along->stride - 2 && is_inside(begin))
#define FORGET_HALVING                                                                             \
  segment = nondet_i16();                                                                          \
  begin = nondet_i32();                                                                            \
  missing = any_within(-MOST_MISSING, ANHYST_Q31_MAX);                                             \
  end = nondet_i16()

#define HALF (ONE / 2)
/* What may be missing of a target. */
#define MOST_MISSING (ONE + HALF / 2)

#include "compensator/cells.c"

static int16_t block_words[ANHYST_BLOCK_MOST_WORDS]; /* any */
static int32_t rested[ANHYST_CELLS];                 /* any plays */

/* A block that passed its check. */
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
  cell_path along;
  set_rows(&along, words);
  const int32_t end = words[ANHYST_WORD_CELLS_ROWS] + (count + 1) * along.stride;
  words[ANHYST_WORD_LENGTH] = (int16_t)any_within(end, ANHYST_BLOCK_MOST_WORDS);
  SHOW(along.stride >= 9 && along.outer >= 0 && along.stride > 2 * along.outer);
  SHOW(along.narrow >= 2 && along.wide <= 13 && along.narrow <= along.wide);
}

/* The places of rows are numbers here: the first row begins at this one. */
static int32_t place_of(const cell_path *along, const int16_t *at)
{
  return (int32_t)(at - along->rows);
}

/* A place of a row, before the last of its entries. */
static int is_on(const cell_path *along, anhyst_spot spot, int32_t row)
{
  const int32_t segment = place_of(along, spot.at) - row * along->stride;
  return segment >= 0 && segment <= along->stride - 2 && spot.part >= 0 && spot.part <= 0x7FFF;
}

static int is_path(const cell_path *along)
{
  return along->active >= 1 && along->active <= along->cells + 1 && along->moved >= 0 &&
         along->moved <= along->cells + 1 && is_inside(along->x) && is_inside(along->rest) &&
         is_inside(along->low) && (along->mirror == 0 || along->mirror == -1) &&
         place_of(along, along->row) == (along->active - 1) * along->stride &&
         is_on(along, along->left, 0);
}

/* A segment of a row, of which the first begins at this place. */
static anhyst_spot any_spot(const cell_path *along, const int16_t *row)
{
  const anhyst_spot spot = {row + any_within(0, along->stride - 2), any_within(0, 0x7FFF)};
  return spot;
}

static cell_path any_path(void)
{
  cell_path along;
  any_block(block_words);
  set_rows(&along, block_words);
  for (int16_t i = 0; i < ANHYST_CELLS; i++) {
    rested[i] = nondet_i32();
  }
  along.plays = rested;
  along.active = (int16_t)any_within(1, along.cells + 1);
  along.moved = (int16_t)any_within(0, along.cells + 1);
  along.row = row_of(&along, along.active);
  along.left = any_spot(&along, along.rows);
  along.risen = nondet_i32();
  along.rest = any_within(-ONE, ONE - 1);
  along.x = any_within(-ONE, ONE - 1);
  along.low = any_within(-ONE, ONE - 1);
  along.mirror = nondet_i16() != 0 ? -1 : 0;
  along.segment = along.row;
  SHOW(is_path(&along));
  return along;
}

/* Targets that a current or a flux can ask for, over 4. */
#define MOST_TARGET (HALF + HALF / 4)

static anhyst_arms any_arms(void)
{
  const anhyst_arms arms = {any_within(-HALF, HALF),
                            (int16_t)any_within(-ANHYST_Q15_MAX, ANHYST_Q15_MAX),
                            (int16_t)any_within(1, ANHYST_Q15_MAX)};
  return arms;
}

static int is_target(const equation *solve)
{
  const int32_t most = solve->arms == 0 ? HALF / 2 + 1 : MOST_TARGET;
  return solve->target >= -most && solve->target <= most;
}

static equation any_equation(const anhyst_arms *arms)
{
  const equation solve = {(int16_t)any_within(1, ANHYST_Q15_MAX), nondet_i16() != 0 ? arms : 0,
                          nondet_i32()};
  ASSUME(is_target(&solve));
  return solve;
}

/* ---- contracts ---- */

#ifdef VALUE_BY_CONTRACT
static inline int32_t anhyst_value_at(anhyst_spot spot)
{
  SHOW(spot.part >= 0 && spot.part <= 0x7FFF);
  return any_within(-ANHYST_Q15_MAX * 32768, ANHYST_Q15_MAX * 32768);
}

static inline number between(spot of, const entry *other)
{
  SHOW(of.part >= 0 && of.part <= 0x7FFF);
  return any_within(-ANHYST_Q15_MAX * 32768, ANHYST_Q15_MAX * 32768);
}
#endif

#ifdef SPOT_BY_CONTRACT
static inline spot spot_on(const cell_path *along, const entry *row, number x)
{
  SHOW(is_inside(x));
  SHOW(place_of(along, row) >= 0 && place_of(along, row) <= along->cells * along->stride);
  return any_spot(along, row);
}
#endif

#ifdef RESIDUAL_BY_CONTRACT
static inline number missing_at(const equation *solve, number x, number m)
{
  (void)m;
  SHOW(is_inside(x) && is_target(solve));
  return any_within(-MOST_MISSING, MOST_MISSING);
}

static inline number part_with_target(const equation *solve, const entry *segment, grid width,
                                      number missing)
{
  (void)segment;
  SHOW(missing >= -MOST_MISSING && is_target(solve));
  SHOW(width >= 2U && width <= 13U);
  return any_within(0, 0x8000);
}
#endif

#ifdef PART_BY_CONTRACT
static inline number ratio_part(number missing, number rise)
{
  SHOW(missing >= 0 && missing < rise);
  return any_within(0, 0x7FFF);
}
#endif

#ifdef NODE_BY_CONTRACT
static number node(const cell_path *along, int segment)
{
  SHOW(segment >= 0 && segment <= along->stride - 2);
  return any_within(-ONE, ONE - 1);
}
#endif

static int is_candidate(const anhyst_candidate *at);

#ifdef TRAVEL_BY_CONTRACT
static number travel(const entry *words, const cells_memory *from, const number *plays,
                     const arms_type *arms, number wanted, candidate *to)
{
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  SHOW(is_target(&solve));
  ASSUME(is_candidate(to));
  return any_within(-ONE, ONE);
}
#endif

#ifdef SEGMENT_BY_CONTRACT
static inline int meet_on_segment(const entry *words, const arms_type *arms, number wanted,
                                  candidate *at, number *flux)
{
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  SHOW(is_target(&solve) && is_inside(at->memory.cells.joined));
  at->memory.cells.x = any_within(-ONE, ONE - 1);
  *flux = nondet_i32();
  return any_within(NOT_MET, BEYOND);
}

static number go_beyond(const entry *words, const cells_memory *from, const number *plays,
                        const arms_type *arms, number wanted, candidate *at, int met)
{
  const equation solve = {words[ANHYST_WORD_CELLS_AIR], arms, wanted};
  SHOW(is_target(&solve) && met != MET);
  return nondet_i32();
}
#endif

#ifdef DESCRIBE_BY_CONTRACT
static void describe(const entry *words, int segment, number begin, grid width, number rest,
                     candidate *at)
{
  cell_path along;
  set_rows(&along, words);
  SHOW(is_inside(begin) && is_inside(rest) && width >= 2U && width <= 13U);
  SHOW(segment >= words[ANHYST_WORD_CELLS_ROWS]);
  SHOW(segment <= words[ANHYST_WORD_CELLS_ROWS] + (along.cells + 1) * along.stride - 2);
  at->of.cells.segment = (int16_t)segment;
  at->of.cells.fineness = (uint16_t)width;
  at->of.cells.rise = (int16_t)any_within(0, ANHYST_Q15_MAX);
  at->of.cells.flux = any_within(-ONE, ONE);
}
#endif

/* ---- proofs ---- */

/* Where a field falls on a row of any size, and back. */
static void prove_rows(void)
{
  const cell_path along = any_path();
  const int32_t x = any_within(-ONE, ONE - 1);
  const anhyst_spot spot = spot_on(&along, along.row, x);
  SHOW(is_on(&along, spot, along.active - 1));
  const grid width = grid_on(&along, x);
  const int32_t begin = begin_of(x, width);
  SHOW(is_inside(begin) && begin <= x && x - begin < width_of(width));
  SHOW(begin + width_of(width) <= ONE && part_at(x, begin, width) == spot.part);
  const int16_t segment = (int16_t)any_within(0, along.stride - 2);
  SHOW(is_inside(node(&along, segment)));
}

static void prove_part(void)
{
  const int32_t d = any_within(1, ANHYST_Q31_MAX);
  const int32_t found = ratio_part(any_within(0, d - 1), d);
  SHOW(found >= 0 && found <= 0x7FFF);
}

static void prove_residual(void)
{
  const cell_path along = any_path();
  const anhyst_arms arms = any_arms();
  const equation solve = any_equation(&arms);
  const int32_t x = any_within(-ONE, ONE - 1);
  const anhyst_spot spot = any_spot(&along, along.row);
  ASSUME(spot.at[1] >= spot.at[0] && spot.at[1] - spot.at[0] <= ANHYST_Q15_MAX);
  const int32_t missing = missing_at(&solve, x, value_at(spot) + along.rest);
  SHOW(missing >= -MOST_MISSING && missing <= MOST_MISSING);
  const int32_t left = any_within(-MOST_MISSING, ANHYST_Q31_MAX);
  const int32_t part = part_with_target(&solve, spot.at, grid_on(&along, x), left);
  SHOW(part >= 0 && part <= 0x8000);
}

static void prove_joins(void)
{
  cell_path along = any_path();
  const int32_t low = any_within(-ONE, ONE - 1);
  const int16_t cell = (int16_t)any_within(1, along.cells + 1);
  const int32_t at = joins_at(&along, cell, low);
  SHOW(at >= low && at < ONE);
  ASSUME(cell <= along.cells);
  along.active = cell;
  along.row = row_of(&along, cell);
  const int32_t with = rests_with(&along, any_spot(&along, along.row), along.cells);
  SHOW(with > -ONE && with < ONE);
}

static void prove_find_left(void)
{
  cell_path along = any_path();
  ASSUME(along.active <= along.cells);
  const int16_t active = along.active;
  find_left(&along, (int16_t)any_within(0, along.cells));
  SHOW(is_path(&along) && along.moved > active && along.active == active);
}

static void prove_rejoin(void)
{
  cell_path along = any_path();
  const anhyst_arms arms = any_arms();
  const equation solve = any_equation(&arms);
  const int32_t low = any_within(-ONE, ONE - 1);
  ASSUME(along.active < along.moved);
  const int32_t last = rejoin(&along, &solve, low);
  SHOW(is_path(&along) && is_inside(last));
}

static void prove_turn(void)
{
  cell_path along = any_path();
  turn(&along, any_spot(&along, along.row));
  SHOW(is_path(&along) && along.active == 1);
}

static void prove_go(void)
{
  cell_path along = any_path();
  const anhyst_arms arms = any_arms();
  const equation solve = any_equation(&arms);
  const int32_t low = any_within(-ONE, ONE - 1);
  const int32_t high = any_within(low, ONE - 1);
  go(&along, &solve, any_spot(&along, along.row).at, low, high);
  SHOW(is_path(&along) && along.x >= low && along.x <= high);
}

static int is_memory(const anhyst_cells_memory *to)
{
  return is_inside(to->x) && is_inside(to->rest) && to->active >= -ANHYST_CELLS - 1 &&
         to->active <= ANHYST_CELLS + 1;
}

static anhyst_cells_memory any_memory(void)
{
  const anhyst_cells_memory any = {nondet_i32(), nondet_i32(), nondet_i32(), nondet_i32(),
                                   nondet_i32()};
  return any;
}

/* What a step leaves that a candidate is taken for. */
static int is_candidate(const anhyst_candidate *at)
{
  return is_memory(&at->memory.cells) && is_inside(at->of.cells.joins) &&
         at->of.cells.flux >= -ONE && at->of.cells.flux <= ONE && at->of.cells.rise >= 0 &&
         at->of.cells.fineness >= 2U && at->of.cells.fineness <= 13U;
}

/* From the segment of a path on, that of a candidate which knows where it stands. */
static void prove_slid(void)
{
  const cell_path along = any_path();
  const anhyst_arms arms = any_arms();
  const equation solve = any_equation(&arms);
  anhyst_compensator c;
  const anhyst_cells_memory memory = {
      mirrored(along.x, along.mirror), mirrored(along.rest, along.mirror),
      along.mirror == 0 ? along.active : -along.active, along.risen, any_within(-ONE, ONE - 1)};
  anhyst_candidate *at = &c.next;
  c.words = block_words;
  at->memory.cells = memory;
  at->of.cells.joins = any_within(along.x, ONE - 1);
  at->of.cells.flux = any_within(-ONE, ONE);
  at->of.cells.segment = (int16_t)(spot_on(&along, along.row, along.x).at - block_words);
  at->of.cells.rise = (int16_t)any_within(0, ANHYST_Q15_MAX);
  at->of.cells.fineness = (uint16_t)grid_on(&along, along.x);
  int32_t flux = 0;
  const int met = meet_on_segment(block_words, solve.arms, solve.target, at, &flux);
  if (met != MET) {
    (void)go_beyond(block_words, &c.memory.cells, c.plays, solve.arms, solve.target, at, met);
  }
  SHOW(is_candidate(at));
}

/* From any memory, for any flux and current, under any limits. */
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
  (void)cells_field(&c);
  (void)cells_flux(&c, nondet_i32());
}

static void prove_keep(void)
{
  (void)any_path();
  const anhyst_cells_memory from = any_memory();
  keep_plays(block_words, &from, rested);
}

int main(void)
{
  PART();
  return 0;
}
