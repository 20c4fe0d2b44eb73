/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status anhyst_map_check_x(const anhyst_map_x *map)
{
  const ANHYST_REAL largest = R(1e30);
  const uint16_t columns = map->force_segments;
  const int head = map->entries != 0 && columns >= 1U && columns <= 4096U &&
                   map->gap_segments >= 1U && map->gap_segments <= 64U &&
                   map->force_low >= -largest && map->force_low < map->force_high &&
                   map->force_high <= largest && map->gap_low >= -largest &&
                   map->gap_low < map->gap_high && map->gap_high <= largest;
  if (!head) {
    return ANHYST_BAD_PARAMETER;
  }
  for (uint16_t row = 0; row <= map->gap_segments; row++) {
    const ANHYST_REAL *entries = map->entries + (size_t)row * (columns + 1U);
    if (!anhyst_rises_x(entries, columns, -largest, largest)) {
      return ANHYST_BAD_PARAMETER;
    }
  }
  return ANHYST_OK;
}

static anhyst_spot_x gap_spot(const anhyst_map_x *map, ANHYST_REAL gap)
{
  return anhyst_spot_of_x(map->gap_segments, (gap - map->gap_low) / (map->gap_high - map->gap_low) *
                                                 (ANHYST_REAL)map->gap_segments);
}

/* The entry of a column, interpolated over the gap. */
static ANHYST_REAL entry_at(const anhyst_map_x *map, anhyst_spot_x gap, uint16_t column)
{
  const size_t row = (size_t)map->force_segments + 1U;
  const ANHYST_REAL *entry = map->entries + gap.index * row + column;
  return entry[0] + gap.part * (entry[row] - entry[0]);
}

ANHYST_REAL anhyst_map_value_x(const anhyst_map_x *map, ANHYST_REAL force, ANHYST_REAL gap)
{
  const anhyst_spot_x row = gap_spot(map, gap);
  const anhyst_spot_x column = anhyst_spot_of_x(
      map->force_segments, (force - map->force_low) / (map->force_high - map->force_low) *
                               (ANHYST_REAL)map->force_segments);
  const ANHYST_REAL low = entry_at(map, row, column.index);
  const ANHYST_REAL high = entry_at(map, row, (uint16_t)(column.index + 1U));
  return low + column.part * (high - low);
}

ANHYST_REAL anhyst_map_force_x(const anhyst_map_x *map, ANHYST_REAL value, ANHYST_REAL gap)
{
  const anhyst_spot_x row = gap_spot(map, gap);
  uint16_t first = 0;
  uint16_t last = map->force_segments;
  while (last - first > 1) {
    const uint16_t middle = (uint16_t)((first + last) / 2);
    if (entry_at(map, row, middle) <= value) {
      first = middle;
    } else {
      last = middle;
    }
  }
  const ANHYST_REAL low = entry_at(map, row, first);
  const ANHYST_REAL high = entry_at(map, row, last);
  ANHYST_REAL part = R(0.0);
  if (value >= high) {
    part = R(1.0);
  } else if (value > low) {
    part = (value - low) / (high - low);
  }
  return map->force_low + (map->force_high - map->force_low) *
                              (((ANHYST_REAL)first + part) / (ANHYST_REAL)map->force_segments);
}
