/* SPDX-License-Identifier: Apache-2.0 */
/* Operations in floating point for the templates map.h and play_map.h. ../map_fixed.h describes the
   functions. The number type and the map type are defined before. */

typedef number entry;

/* Maximum size of an entry, and of the difference between adjacent entries. */
#define MAX_ENTRY ((number)1e30)
#define ONE ((number)1)

/* Position of a signal in a table with equal segments. */
typedef struct {
  size_t index;    /* index of the segment */
  number fraction; /* position within the segment, 0..1 */
} table_position;

/* Returns the position of a signal that is given in units of the segment width. Outside the table,
   returns the nearest end, and for NaN the lower end. */
static inline table_position locate_signal(uint16_t segments, number signal)
{
  table_position position = {0, 0};
  if (signal >= (number)segments) {
    position.index = segments - 1U;
    position.fraction = ONE;
  } else if (signal > 0) {
    position.index = (uint16_t)signal;
    position.fraction = signal - (number)position.index;
  }
  return position;
}

static inline table_position locate_gap(const map_type *map, number gap)
{
  return locate_signal(map->gap_segments, (gap - map->gap_low) / (map->gap_high - map->gap_low) *
                                              (number)map->gap_segments);
}

static inline table_position locate_force(const map_type *map, number force)
{
  return locate_signal(map->force_segments, (force - map->force_low) /
                                                (map->force_high - map->force_low) *
                                                (number)map->force_segments);
}

static inline size_t columns_of(const map_type *map) { return map->force_segments; }
static inline size_t rows_of(const map_type *map) { return map->gap_segments; }

static inline number force_at_position(const map_type *map, table_position at)
{
  return map->force_low + (map->force_high - map->force_low) *
                              (((number)at.index + at.fraction) / (number)map->force_segments);
}

static inline int is_range_valid(number low, number high)
{
  return low >= -MAX_ENTRY && low < high && high <= MAX_ENTRY;
}

static inline int is_shape_valid(const map_type *map)
{
  return map->entries != NULL && map->force_segments >= 1U && map->force_segments <= 4096U &&
         map->gap_segments >= 1U && map->gap_segments <= 64U &&
         is_range_valid(map->force_low, map->force_high) &&
         is_range_valid(map->gap_low, map->gap_high);
}

static inline number times_fraction(number a, number f) { return f * a; }

static inline number interpolate(entry from, entry to, number fraction)
{
  return from + fraction * (to - from);
}

static inline number quotient_below_one(number numerator, number denominator)
{
  return numerator / denominator;
}
