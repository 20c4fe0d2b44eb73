/* SPDX-License-Identifier: Apache-2.0 */
/* A template: the map over force and gap, the same text in every format. Before it are the
   operations of the format: ../map_fixed.h, or map_real.h. */

/* Whether no row falls, and no number is too large or too far from its neighbours. */
static inline int is_map(const map_type *map)
{
  if (!has_shape(map)) {
    return 0;
  }
  const entry *now = map->entries;
  const size_t length = columns_of(map) + 1U;
  for (size_t row = 0; row <= rows_of(map); row++) {
    for (size_t column = 0; column < length; column++) {
      const number value = now[0];
      const number rise = column > 0U ? value - now[-1] : 0;
      const number change = row > 0U ? value - *(now - length) : 0;
      if (!(value >= -LARGEST && value <= LARGEST && rise >= 0 && rise <= LARGEST &&
            change >= -LARGEST && change <= LARGEST)) {
        return 0;
      }
      now++;
    }
  }
  return 1;
}

/* The row of a table at a gap: a part of the way from one row of entries to the next one. */
typedef struct {
  const entry *first; /* of the row below */
  size_t length;
  number part;
} table_row;

static inline table_row row_at(const map_type *map, number gap)
{
  const place at = gap_place(map, gap);
  const size_t length = columns_of(map) + 1U;
  const table_row row = {map->entries + at.index * length, length, at.part};
  return row;
}

/* The number at a column. */
static inline number at_column(const table_row *row, size_t column)
{
  const entry *below = row->first + column;
  return interpolate(below[0], below[row->length], row->part);
}

static inline number map_value(const map_type *map, number force, number gap)
{
  const table_row row = row_at(map, gap);
  const place at = force_place(map, force);
  const number low = at_column(&row, at.index);
  return low + times(at_column(&row, at.index + 1U) - low, at.part);
}

static inline number map_force(const map_type *map, number value, number gap)
{
  const table_row row = row_at(map, gap);
  size_t above = columns_of(map);
  place at = {0, 0};
  while (above - at.index > 1U) {
    const size_t middle = (at.index + above) / 2U;
    if (at_column(&row, middle) <= value) {
      at.index = middle;
    } else {
      above = middle;
    }
  }
  const number low = at_column(&row, at.index);
  const number high = at_column(&row, above);
  if (value >= high) {
    at.part = ONE;
  } else if (value > low) {
    at.part = ratio_of(value - low, high - low);
  }
  return force_of(map, at);
}
