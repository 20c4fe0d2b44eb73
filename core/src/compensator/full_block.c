/* SPDX-License-Identifier: Apache-2.0 */
/* What the full law asks of a block, and how a memory goes from one block to another. */
#include "full_path.h"

/* Of the interval in which a memory of another block is brought to its flux: leaves 2.4e-7. */
#define HALVINGS 24

/* The largest slope of m over tables that are valid, as it may have been before their entries were
   rounded, which makes a segment steeper by up to one. No path is steeper than the ascending
   branch. */
static int32_t steepest_slope(const int16_t *words)
{
  path along;
  along.curve.n = (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  along.reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  const int16_t *curve = words + words[ANHYST_WORD_FULL_CURVE];
  const int16_t segments = (int16_t)(1 << along.curve.n);
  const int16_t *rising = words + words[ANHYST_WORD_FULL_BRANCH] + segments;
  int32_t most = 0;
  for (int16_t i = 0; i < segments; i++) {
    const int32_t y_rise = (int32_t)rising[i + 1] - rising[i];
    const int32_t x_rise = (int32_t)curve[i + 1] - curve[i];
    const int32_t slope = slope_of_m(&along, slope_of(&along, y_rise > 0 ? y_rise - 1 : 0),
                                     slope_of(&along, x_rise > 0 ? x_rise - 1 : 0));
    most = slope > most ? slope : most;
  }
  return most;
}

/* Whether more field needs more current at every gap: field_arm + flux_arm*(h + slope of m) is
   above zero by more than what rounding between two entries of the tables over the gap can take
   away, half a unit of either arm and one for each product. */
static int current_rises(const int16_t *words)
{
  const int16_t *flux_arm = words + words[ANHYST_WORD_GAP_FLUX_ARM];
  const int16_t *field_arm = words + words[ANHYST_WORD_GAP_FIELD_ARM];
  const int32_t slope = steepest_slope(words);
  const int32_t h = words[ANHYST_WORD_FULL_AIR];
  const int32_t margin = 3 + (h >> 15) + (slope >> 11);
  for (int16_t i = 0; i <= (1 << words[ANHYST_WORD_GAP_SEGMENTS]); i++) {
    const int32_t least = field_arm[i] + ((h * flux_arm[i]) >> 14) + ((slope * flux_arm[i]) >> 10);
    if (flux_arm[i] < 0 && least <= margin) {
      return 0;
    }
  }
  return 1;
}

int anhyst_full_is_valid(const int16_t *words)
{
  const int16_t n = words[ANHYST_WORD_FULL_CURVE_SEGMENTS];
  const int16_t n_inverse = words[ANHYST_WORD_FULL_INVERSE_SEGMENTS];
  /* Slopes of the tables stay within ANHYST_SLOPE_MAX. */
  const int16_t steepest = (int16_t)(ANHYST_Q15_MAX >> (n > 5 && n <= 9 ? n - 5 : 0));
  return words[ANHYST_WORD_FULL_AIR] > 0 && words[ANHYST_WORD_FULL_REVERSIBLE] >= 0 &&
         words[ANHYST_WORD_FULL_PLAY] >= 0 && words[ANHYST_WORD_FULL_RATE] > 0 &&
         anhyst_within(words[ANHYST_WORD_FULL_RATE_SHIFT], 0, 12) &&
         words[ANHYST_WORD_FULL_STEEPNESS] > 0 &&
         anhyst_within(words[ANHYST_WORD_FULL_ITERATIONS], 2, 16) && anhyst_within(n, 3, 9) &&
         anhyst_within(n_inverse, 3, 9) && anhyst_single_is_valid(words, ANHYST_WORD_UNIT_FIELD) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_CURVE], (int16_t)((1 << n) + 1), 0,
                            steepest) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_BRANCH], (int16_t)((2 << n) + 1),
                            -ANHYST_Q15_MAX, steepest) &&
         anhyst_table_rises(words, words[ANHYST_WORD_FULL_INVERSE], (int16_t)((1 << n_inverse) + 1),
                            0, ANHYST_Q15_MAX) &&
         current_rises(words);
}

/* A memory of another block on its way here. */
typedef struct {
  int32_t x;
  int32_t p;
  int32_t behind; /* field at which the anhysteretic is y */
  int32_t rest;   /* of y, by which the tables miss that */
} carried;

/* Moves it so far along the field and takes it for the start of a path; the residual of
   h*x + m = flux there, over 4. It rises with the way. */
static int32_t carried_to(path *along, const carried *from, int32_t way, int16_t air, int32_t flux)
{
  int32_t step;
  along->x = anhyst_clamp(from->x + way, 1 - ONE, ONE - 1);
  along->p = anhyst_clamp(anhyst_clamp(from->p + way, 1 - ONE, ONE - 1), along->x - along->play,
                          along->x + along->play);
  const int32_t behind = anhyst_clamp(from->behind + way, 1 - ONE, ONE - 1);
  const int32_t pull = odd_value(along->curve, behind, &step);
  along->y = anhyst_clamp(pull + from->rest, 1 - ONE, ONE - 1);
  const int32_t m = magnetisation(along, along->y, odd_value(along->curve, along->x, &step));
  return anhyst_scale(along->x, air) + anhyst_scale(m, 16384) - (flux >> 4);
}

/* A field of another block in this one's unit, within its tables. */
static int32_t in_reach(int32_t x, const int16_t *before, const int16_t *words)
{
  return anhyst_clamp(anhyst_in_unit(x, before, words, ANHYST_WORD_UNIT_FIELD), 1 - ONE, ONE - 1);
}

/* The iron stays as far behind its anhysteretic, in field, as it was, and so does its play; all
   move along the field to where they give the flux under this block, so that no demand that stays
   the same has to be reached over a branch. The play turns here: a path that began under
   another law does not lead here under this one. */
void anhyst_full_carry(anhyst_compensator *c, const int16_t *words, int32_t flux)
{
  const int16_t *before = c->words;
  anhyst_full_memory *memory = &c->memory.full;
  path along;
  carried from;
  int32_t step;
  prepare(&along, before, memory);
  const int32_t behind = odd_value(inverse_of(before), along.y, &step);
  from.rest = along.y - odd_value(along.curve, behind, &step);
  from.x = in_reach(along.x, before, words);
  from.p = in_reach(along.p, before, words);
  from.behind = in_reach(behind, before, words);
  prepare(&along, words, memory);
  int32_t low = -2 * ONE;
  int32_t high = 2 * ONE;
  for (int16_t i = 0; i < HALVINGS; i++) {
    const int32_t middle = (low + high) / 2;
    if (carried_to(&along, &from, middle, words[ANHYST_WORD_FULL_AIR], flux) < 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  memory->x = along.x * 4;
  memory->y = along.y * 4;
  memory->p = along.p * 4;
  memory->turn = memory->p;
  memory->level = memory->y;
}
