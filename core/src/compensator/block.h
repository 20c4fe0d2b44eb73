/* SPDX-License-Identifier: Apache-2.0 */
/* What the checks of a parameter block are made of; see layout.h. */
#ifndef ANHYST_BLOCK_H
#define ANHYST_BLOCK_H

#include "anhyst/compensator/compensator.h"

static inline int anhyst_within(int16_t word, int16_t low, int16_t high)
{
  return word >= low && word <= high;
}

/* Whether a table of so many entries lies behind the head of the block and inside it. */
int anhyst_table_inside(const int16_t *words, int16_t first, int16_t entries);

/* Whether it does, never falls, starts at the least value or above, and rises by no more than so
   much from entry to entry. */
int anhyst_table_rises(const int16_t *words, int16_t first, int16_t entries, int16_t least,
                       int16_t steepest);

/* Whether the word names a table over the gap, neighbours of which differ by at most 32767, and
   every entry of which is at least so much. */
int anhyst_over_gap_is_valid(const int16_t *words, int16_t word, int16_t least);

/* Whether the word begins a single within 2^-60..2^60. */
int anhyst_single_is_valid(const int16_t *words, int16_t word);

/* A number of the memory, counted in the unit that stands at this word of the block before, in that
   of another block; both valid. |a| <= 2^30, saturates. The same unit: the same number; else the
   error is below 2^-22 of the result and 8 units in the last place of the larger of the two. */
int32_t anhyst_in_unit(int32_t a, const int16_t *before, const int16_t *words, int16_t word);

#endif
