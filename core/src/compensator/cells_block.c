/* SPDX-License-Identifier: Apache-2.0 */
/* What the law of cells asks of a block, where a path of it begins and what it leaves behind, and
   how a memory goes from one block to another. */
#include "cells_path.h"

/* Of the interval in which a memory of another block is brought to its flux: leaves 2.4e-7. */
#define HALVINGS 24

/* The magnetisation of all cells at rest but cell 0, counted as if they had risen. */
static int32_t all_alone(const cell_path *along)
{
  int32_t sum = 0;
  for (int cell = 1; cell <= along->cells; cell++) {
    const int32_t x = inside(anhyst_add_q31(play_of(along, cell), width(along, cell)));
    sum = inside(sum + beyond(along, spot_on(along, row_of(along, cell), x)));
  }
  return sum;
}

int32_t anhyst_cells_at_rest(const int16_t *words, const int32_t *plays)
{
  cell_path along;
  anhyst_cells_rows(&along, words);
  along.plays = plays;
  along.moved = 0;
  along.falling = 0;
  return all_alone(&along);
}

/* Only cell 0 moves. */
void anhyst_cells_start(const int16_t *words, const int32_t *plays, anhyst_cells_memory *memory)
{
  memory->rest = anhyst_cells_at_rest(words, plays);
  memory->active = 1;
  memory->risen = -1;
  memory->joined = memory->x;
}

void anhyst_cells_keep(const int16_t *words, const anhyst_cells_memory *from, int32_t *plays)
{
  cell_path along;
  anhyst_cells_rows(&along, words);
  const int32_t falling = from->active < 0 ? -1 : 0;
  const int32_t x = inside(turned(from->x, falling));
  const int moved = moving_cells(&along, from);
  for (int cell = 1; cell < moved; cell++) {
    plays[cell - 1] = turned(x - width(&along, cell), falling);
  }
}

/* Whether all rows of a column lie within less than 1. */
static int rows_are_near(const cell_path *along, int column)
{
  int32_t low = ANHYST_Q15_MAX;
  int32_t high = -ANHYST_Q15_MAX;
  for (int row = 0; row <= along->cells; row++) {
    const int32_t entry = along->rows[row * along->stride + column];
    low = entry < low ? entry : low;
    high = entry > high ? entry : high;
  }
  return high - low <= ANHYST_Q15_MAX;
}

/* Whether rows never fall, and no two of them differ by 1 anywhere. */
static int rows_are_valid(const int16_t *words)
{
  cell_path along;
  anhyst_cells_rows(&along, words);
  const int16_t first = words[ANHYST_WORD_CELLS_ROWS];
  const int rows = along.cells + 1;
  if ((int32_t)rows * along.stride > ANHYST_BLOCK_MOST_WORDS ||
      !anhyst_table_inside(words, first, (int16_t)(rows * along.stride))) {
    return 0;
  }
  for (int row = 0; row < rows; row++) {
    const int16_t begin = (int16_t)(first + row * along.stride);
    if (!anhyst_table_rises(words, begin, (int16_t)along.stride, -ANHYST_Q15_MAX, ANHYST_Q15_MAX)) {
      return 0;
    }
  }
  for (int column = 0; column < along.stride; column++) {
    if (!rows_are_near(&along, column)) {
      return 0;
    }
  }
  return 1;
}

/* The most that a row rises in a segment, narrow or wide. */
static int16_t steepest(const cell_path *along, int narrow)
{
  int16_t most = 0;
  for (int cells = 1; cells <= along->cells + 1; cells++) {
    const int16_t *row = row_of(along, cells);
    for (int i = 0; i < along->stride - 1; i++) {
      const int within = i >= along->outer && i < along->stride - 1 - along->outer;
      const int16_t rise = (int16_t)(row[i + 1] - row[i]);
      most = within == narrow && rise > most ? rise : most;
    }
  }
  return most;
}

/* Whether more field needs more of what these arms make of it and of its flux on every segment, by
   more than a unit of either arm can take away. */
static int rises_with(const int16_t *words, int16_t flux_arm, int16_t field_arm)
{
  cell_path along;
  anhyst_cells_rows(&along, words);
  for (int narrow = 0; narrow < 2 && flux_arm < 0; narrow++) {
    const int32_t x = (int32_t)((uint32_t)0x8000 << (narrow != 0 ? along.narrow : along.wide));
    const int32_t flux =
        (int32_t)steepest(&along, narrow) * 8192 + anhyst_scale(x, words[ANHYST_WORD_CELLS_AIR]);
    if (anhyst_scale(flux, (int16_t)(flux_arm - 1)) +
            (anhyst_scale(x, (int16_t)(field_arm - 1)) >> 2) <=
        4) {
      return 0;
    }
  }
  return 1;
}

/* Whether more field needs more current at every gap, rounding between two entries of the tables
   over it included. */
static int current_rises(const int16_t *words)
{
  const int16_t *flux_arm = words + words[ANHYST_WORD_GAP_FLUX_ARM];
  const int16_t *field_arm = words + words[ANHYST_WORD_GAP_FIELD_ARM];
  for (int i = 0; i <= (1 << words[ANHYST_WORD_GAP_SEGMENTS]); i++) {
    if (!rises_with(words, flux_arm[i], field_arm[i])) {
      return 0;
    }
  }
  return 1;
}

/* Whether there is room for the layers of a block, and each answers more field with more flux where
   nothing but iron is around it. A block without layers says nothing of them. */
static int layers_are_valid(const int16_t *words)
{
#if ANHYST_MEMORIES > 1
  if (words[ANHYST_WORD_SOLID_LAYERS] != 0) {
    return anhyst_solid_is_valid(words) && rises_with(words, words[ANHYST_WORD_SOLID_OWN], 16384);
  }
#endif
  int16_t said = 0;
  for (int i = ANHYST_WORD_SOLID_LAYERS; i <= ANHYST_WORD_SOLID_LAMINATED; i++) {
    said = (int16_t)(said | words[i]);
  }
  return said == 0;
}

int anhyst_cells_is_valid(const int16_t *words)
{
  return words[ANHYST_WORD_CELLS_AIR] > 0 &&
         anhyst_within(words[ANHYST_WORD_CELLS_COUNT], 1, ANHYST_CELLS) &&
         anhyst_within(words[ANHYST_WORD_CELLS_SEGMENTS], 2, 8) &&
         anhyst_within(words[ANHYST_WORD_CELLS_ZONE], 0, 5) &&
         words[ANHYST_WORD_CELLS_ZONE] <= words[ANHYST_WORD_CELLS_SEGMENTS] &&
         anhyst_single_is_valid(words, ANHYST_WORD_UNIT_FIELD) &&
         anhyst_table_rises(words, words[ANHYST_WORD_CELLS_THRESHOLDS],
                            words[ANHYST_WORD_CELLS_COUNT], 1, ANHYST_Q15_MAX) &&
         rows_are_valid(words) && current_rises(words) && layers_are_valid(words);
}

/* Where the plays of all cells stand, the field for cell 0 and those that there are not. */
static void stand(const int16_t *words, const anhyst_cells_memory *memory, const int32_t *plays,
                  int32_t *stairs)
{
  cell_path along;
  anhyst_cells_begin(&along, words, memory, plays);
  for (int cell = 0; cell <= ANHYST_CELLS; cell++) {
    int32_t play = along.x;
    if (cell > 0 && cell <= along.cells) {
      play = cell < along.active ? along.x - width(&along, cell) : at_rest(&along, cell);
    }
    stairs[cell] = inside(turned(play, along.falling));
  }
}

/* Where a play of this half-width stands, in a straight line between those beside it. */
static int32_t play_between(const cell_path *along, const int32_t *stairs, int32_t half_width)
{
  int below = 0;
  while (below < along->cells && width(along, below + 1) <= half_width) {
    below++;
  }
  const int32_t begin = below > 0 ? width(along, below) : 0;
  if (below == along->cells || half_width == begin) {
    return stairs[below];
  }
  const int32_t part = anhyst_ratio(half_width - begin, width(along, below + 1) - begin);
  return stairs[below] + anhyst_share(inside(stairs[below + 1] - stairs[below]), part);
}

/* Moves field and plays so far along the field; the residual of h*x + m = flux there, over 4. It
   rises with the way. */
static int32_t carried_to(cell_path *along, const int32_t *stairs, int32_t way, int16_t air,
                          int32_t flux, int32_t *plays)
{
  along->x = inside(anhyst_add_q31(stairs[0], way));
  along->plays = plays;
  for (int cell = 1; cell <= along->cells; cell++) {
    plays[cell - 1] = anhyst_add_q31(stairs[cell], way);
    plays[cell - 1] = anhyst_clamp(at_rest(along, cell), along->x - width(along, cell),
                                   along->x + width(along, cell));
  }
  const int32_t m = anhyst_value_at(spot_on(along, along->rows, along->x)) + all_alone(along);
  return (m >> 2) + anhyst_scale(along->x, air) - (flux >> 2);
}

/* All move along the field, as far from each other as they were, to where they give the flux under
   this block, so that no demand that stays the same has to be reached over a branch. A play of
   another width stands between those beside it. */
void anhyst_cells_carry(const int16_t *before, const int16_t *words, int32_t flux,
                        anhyst_cells_memory *memory, int32_t *plays)
{
  int32_t old[ANHYST_CELLS + 1];
  int32_t stairs[ANHYST_CELLS + 1] = {0};
  const anhyst_cells_memory none = {0, 0, 0, 0, 0};
  cell_path along;
  cell_path other;
  stand(before, memory, plays, old);
  anhyst_cells_rows(&other, before);
  anhyst_cells_rows(&along, words);
  along.moved = 0;
  along.falling = 0;
  for (int cell = 0; cell <= along.cells; cell++) {
    int32_t half_width = 0;
    if (cell > 0) {
      /* NOLINTNEXTLINE(readability-suspicious-call-argument): here from the new unit to the old */
      half_width = anhyst_in_unit(width(&along, cell), words, before, ANHYST_WORD_UNIT_FIELD);
    }
    stairs[cell] = inside(anhyst_in_unit(play_between(&other, old, half_width), before, words,
                                         ANHYST_WORD_UNIT_FIELD));
  }
  int32_t low = -2 * (ONE - 1);
  int32_t high = 2 * (ONE - 1);
  for (int i = 0; i < HALVINGS; i++) {
    const int32_t middle = low / 2 + high / 2;
    if (carried_to(&along, stairs, middle, words[ANHYST_WORD_CELLS_AIR], flux, plays) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  *memory = none;
  memory->x = along.x;
  anhyst_cells_start(words, plays, memory);
}
