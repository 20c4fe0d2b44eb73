/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the rows of the play-cell law: the value between two entries, and the difference between
   two rows there, are below 1. Tries every rise and every change of the difference at every
   position. Value and difference are linear in the entries, so that the extreme entries are
   sufficient. */
#include "compensator/cells_fixed.h"

#define MAX_VALUE ((int32_t)ANHYST_Q15_MAX * 32768)

static int is_within(int32_t a) { return a >= -MAX_VALUE && a <= MAX_VALUE; }

/* Checks two entries with this rise. */
static int value_is_within(int32_t low, int32_t rise, int32_t part)
{
  const int16_t entries[2] = {(int16_t)low, (int16_t)(low + rise)};
  const anhyst_table_position table_position = {entries, part};
  return is_within(anhyst_table_value(table_position));
}

/* Checks two rows with a difference at one entry, and a change of the difference up to the next
   entry. */
static int difference_is_within(int32_t low, int32_t change, int32_t part)
{
  const int32_t half = low / 2; /* no entry exceeds 16 bits */
  const int32_t next = (low + change) / 2;
  const int16_t of[2] = {(int16_t)-half, (int16_t)-next};
  const int16_t other[2] = {(int16_t)(low - half), (int16_t)(low + change - next)};
  const anhyst_table_position table_position = {of, part};
  return is_within(row_difference(table_position, other));
}

int main(void)
{
  for (int32_t rise = 0; rise <= ANHYST_Q15_MAX; rise++) {
    for (int32_t part = 0; part <= 0x7FFF; part++) {
      if (!value_is_within(-ANHYST_Q15_MAX, rise, part) ||
          !value_is_within(ANHYST_Q15_MAX - rise, rise, part)) {
        return 1;
      }
    }
  }
  for (int32_t change = -2 * ANHYST_Q15_MAX; change <= 2 * ANHYST_Q15_MAX; change++) {
    const int32_t most = ANHYST_Q15_MAX - (change > 0 ? change : 0);
    const int32_t least = -ANHYST_Q15_MAX - (change < 0 ? change : 0);
    for (int32_t part = 0; part <= 0x7FFF; part++) {
      if (!difference_is_within(least, change, part) || !difference_is_within(most, change, part)) {
        return 1;
      }
    }
  }
  return 0;
}
