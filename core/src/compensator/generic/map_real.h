/* SPDX-License-Identifier: Apache-2.0 */
/* Operations in floating point for the templates map.h and play_map.h. Before it are typedefs of
   number and map_type. */

typedef number entry;

#define LARGEST ((number)1e30) /* size of an entry, and of the step to its neighbour */
#define ONE ((number)1)

/* A signal among equal segments. */
typedef struct {
  size_t index; /* of the segment */
  number part;  /* of the segment, 0..1 */
} place;

/* The place of a signal, counted in segments. Outside the table it is the nearest end; for what is
   not a number it is the lower one. */
static inline place place_of(uint16_t segments, number signal)
{
  place at = {0, 0};
  if (signal >= (number)segments) {
    at.index = segments - 1U;
    at.part = ONE;
  } else if (signal > 0) {
    at.index = (uint16_t)signal;
    at.part = signal - (number)at.index;
  }
  return at;
}

static inline place gap_place(const map_type *map, number gap)
{
  return place_of(map->gap_segments, (gap - map->gap_low) / (map->gap_high - map->gap_low) *
                                         (number)map->gap_segments);
}

static inline place force_place(const map_type *map, number force)
{
  return place_of(map->force_segments, (force - map->force_low) /
                                           (map->force_high - map->force_low) *
                                           (number)map->force_segments);
}

static inline size_t columns_of(const map_type *map) { return map->force_segments; }

static inline size_t rows_of(const map_type *map) { return map->gap_segments; }

/* The force at a part of a segment. */
static inline number force_of(const map_type *map, place at)
{
  return map->force_low + (map->force_high - map->force_low) *
                              (((number)at.index + at.part) / (number)map->force_segments);
}

/* Whether these are the ends of a range of numbers. */
static inline int is_range(number low, number high)
{
  return low >= -LARGEST && low < high && high <= LARGEST;
}

static inline int has_shape(const map_type *map)
{
  return map->entries != NULL && map->force_segments >= 1U && map->force_segments <= 4096U &&
         map->gap_segments >= 1U && map->gap_segments <= 64U &&
         is_range(map->force_low, map->force_high) && is_range(map->gap_low, map->gap_high);
}

static inline number times(number a, number part) { return part * a; }

/* The number at a part of the way from one entry to another. */
static inline number interpolate(entry from, entry to, number part)
{
  return from + part * (to - from);
}

/* numerator/denominator; 0 < numerator < denominator. */
static inline number ratio_of(number numerator, number denominator)
{
  return numerator / denominator;
}
