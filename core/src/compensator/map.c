/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map.h"

#include <stddef.h>

#include "lookup.h"

/* Where a signal falls among 2^n equal segments. */
typedef struct {
  uint16_t index; /* of the segment */
  int32_t part;   /* of it, q31, not negative */
} segment;

static segment segment_of(int32_t signal, uint16_t n)
{
  const uint32_t code = signal > 0 ? (uint32_t)signal : 0U;
  const segment at = {(uint16_t)(code >> (31U - n)), (int32_t)((code << n) & 0x7FFFFFFFUL)};
  return at;
}

/* Entries of a row or column of 2^n segments. */
static uint16_t entries_of(uint16_t n) { return (uint16_t)(((uint32_t)1U << n) + 1U); }

/* The entry of a column, interpolated over the gap, q31. */
static int32_t entry_at(const anhyst_map_q31 *map, segment gap, uint16_t column)
{
  const uint16_t row = entries_of(map->force_segments);
  const int16_t *entry = map->entries + (size_t)gap.index * row + column;
  const int16_t rise = (int16_t)((int32_t)entry[row] - entry[0]);
  return (int32_t)entry[0] * 65536 + 2 * anhyst_scale(gap.part, rise);
}

/* Whether a row never falls, and is at no column further than 32767 from the one before. */
static int row_is_valid(const int16_t *entries, const int16_t *before, uint16_t columns)
{
  for (uint16_t i = 0; i < columns; i++) {
    const int32_t rise = i == 0U ? 0 : (int32_t)entries[i] - entries[i - 1U];
    const int32_t change = (int32_t)entries[i] - before[i];
    if (entries[i] < -ANHYST_Q15_MAX || rise < 0 || rise > ANHYST_Q15_MAX ||
        change < -ANHYST_Q15_MAX || change > ANHYST_Q15_MAX) {
      return 0;
    }
  }
  return 1;
}

anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map)
{
  if (map->entries == NULL || map->force_segments > ANHYST_MAP_FORCE_SEGMENTS ||
      map->gap_segments > ANHYST_MAP_GAP_SEGMENTS) {
    return ANHYST_BAD_PARAMETER;
  }
  const uint16_t columns = entries_of(map->force_segments);
  const uint16_t rows = entries_of(map->gap_segments);
  const int16_t *before = map->entries;
  for (uint16_t row = 0; row < rows; row++) {
    const int16_t *entries = map->entries + (size_t)row * columns;
    if (!row_is_valid(entries, before, columns)) {
      return ANHYST_BAD_PARAMETER;
    }
    before = entries;
  }
  return ANHYST_OK;
}

int32_t anhyst_map_value_q31(const anhyst_map_q31 *map, int32_t force, int32_t gap)
{
  const segment row = segment_of(gap, map->gap_segments);
  const segment column = segment_of(force, map->force_segments);
  const int32_t low = entry_at(map, row, column.index);
  const int32_t high = entry_at(map, row, (uint16_t)(column.index + 1U));
  return low + anhyst_share(high - low, column.part);
}

int32_t anhyst_map_force_q31(const anhyst_map_q31 *map, int32_t value, int32_t gap)
{
  const segment row = segment_of(gap, map->gap_segments);
  const uint16_t n = map->force_segments;
  uint16_t first = 0;
  for (uint16_t step = n; step > 0U; step--) {
    const uint16_t middle = (uint16_t)(first + (1U << (step - 1U)));
    if (entry_at(map, row, middle) <= value) {
      first = middle;
    }
  }
  const int32_t low = entry_at(map, row, first);
  const int32_t high = entry_at(map, row, (uint16_t)(first + 1U));
  const int32_t start = (int32_t)((uint32_t)first << (31U - n));
  if (value >= high) {
    return start + (ANHYST_Q31_MAX >> n);
  }
  if (value <= low) {
    return start;
  }
  return start + (anhyst_ratio(value - low, high - low) >> n);
}
