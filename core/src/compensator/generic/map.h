/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the map over force and gap, for every number format. The operations of a format are
   included before: ../map_fixed.h or map_real.h. */

/* Returns whether no row falls, and entries and differences of adjacent entries are in range. */
static inline int is_map_valid(const map_type *map)
{
  if (!is_shape_valid(map)) {
    return 0;
  }
  const entry *entry_now = map->entries;
  const size_t length = columns_of(map) + 1U;
  for (size_t row = 0; row <= rows_of(map); row++) {
    for (size_t column = 0; column < length; column++) {
      const number value = entry_now[0];
      const number rise = column > 0U ? value - entry_now[-1] : 0;
      const number change = row > 0U ? value - *(entry_now - length) : 0;
      if (!(value >= -MAX_ENTRY && value <= MAX_ENTRY && rise >= 0 && rise <= MAX_ENTRY &&
            change >= -MAX_ENTRY && change <= MAX_ENTRY)) {
        return 0;
      }
      entry_now++;
    }
  }
  return 1;
}

/* Row of a map at a gap, interpolated between two rows of entries. */
typedef struct {
  const entry *first; /* first entry of the row below the gap */
  size_t length;
  number fraction;
} table_row;

static inline table_row row_at_gap(const map_type *map, number gap)
{
  const table_position position = locate_gap(map, gap);
  const size_t length = columns_of(map) + 1U;
  const table_row row = {map->entries + position.index * length, length, position.fraction};
  return row;
}

static inline number column_value(const table_row *row, size_t column)
{
  const entry *below = row->first + column;
  return interpolate(below[0], below[row->length], row->fraction);
}

static inline number map_value(const map_type *map, number force, number gap)
{
  const table_row row = row_at_gap(map, gap);
  const table_position position = locate_force(map, force);
  const number low = column_value(&row, position.index);
  return low + times_fraction(column_value(&row, position.index + 1U) - low, position.fraction);
}

static inline number map_force(const map_type *map, number value, number gap)
{
  const table_row row = row_at_gap(map, gap);
  size_t above = columns_of(map);
  table_position position = {0, 0};
  while (above - position.index > 1U) {
    const size_t middle = (position.index + above) / 2U;
    if (column_value(&row, middle) <= value) {
      position.index = middle;
    } else {
      above = middle;
    }
  }
  const number low = column_value(&row, position.index);
  const number high = column_value(&row, above);
  if (value >= high) {
    position.fraction = ONE;
  } else if (value > low) {
    position.fraction = quotient_below_one(value - low, high - low);
  }
  return force_at_position(map, position);
}
