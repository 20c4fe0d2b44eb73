/* SPDX-License-Identifier: Apache-2.0 */
/* Random fixed-point maps and signals. */
#ifndef TEST_MAPS_H
#define TEST_MAPS_H

#include "anhyst/compensator/map.h"
#include "anhyst/numeric/factor.h"

#include "truth.h"

enum { MOST_COLUMNS = 257, MOST_ROWS = 65, SIGNALS = 400 };

static uint64_t seed = 7;

static inline int32_t any_code(void) { return (int32_t)(uint32_t)(random_bits(&seed) >> 32); }

static inline int32_t any_within(int32_t low, int32_t high)
{
  return (int32_t)(low + (int64_t)(random_bits(&seed) % (uint64_t)((int64_t)high - low + 1)));
}

static inline anhyst_factor any_factor(void)
{
  const anhyst_factor factor = {(int16_t)any_within(-32768, 32767), (int16_t)any_within(-15, 16)};
  return factor;
}

static inline void fill_table(const anhyst_map_q31 *map, int16_t *table, int32_t step)
{
  const int columns = (1 << map->force_segments) + 1;
  const int rows = (1 << map->gap_segments) + 1;
  for (int row = 0; row < rows; row++) {
    int32_t now = any_within(-32767, 0);
    for (int i = 0; i < columns; i++) {
      table[row * columns + i] = (int16_t)(now > 32767 ? 32767 : now);
      now += any_within(0, step);
    }
  }
}

/* Returns a valid table whose neighbours along the force differ by up to a given step. */
static inline anhyst_map_q31 any_map(int16_t *table, uint16_t n, uint16_t m, int32_t step)
{
  const anhyst_map_q31 map = {table, n, m};
  do {
    fill_table(&map, table, step);
    step -= step / 8;
  } while (anhyst_map_check_q31(&map) != ANHYST_OK);
  return map;
}

#endif
