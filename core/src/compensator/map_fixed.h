/* SPDX-License-Identifier: Apache-2.0 */
/* Operations in q31 for the templates generic/map.h and generic/play_map.h. */
#ifndef ANHYST_MAP_FIXED_H
#define ANHYST_MAP_FIXED_H

#include "anhyst/compensator/map.h"

#include <stddef.h>

#include "lookup.h"

typedef int32_t number; /* q31 */
typedef int16_t entry;  /* q15 */
typedef anhyst_map_q31 map_type;

/* Maximum size of an entry, and of the difference between adjacent entries. */
#define MAX_ENTRY ((number)ANHYST_Q15_MAX)

/* Position of a signal in a table with 2^n equal segments. */
typedef struct {
  size_t index;    /* index of the segment */
  number fraction; /* position within the segment, 0..1 */
} table_position;

static inline table_position locate_signal(number signal, uint16_t n)
{
  const uint32_t code = signal > 0 ? (uint32_t)signal : 0U;
  const table_position position = {(size_t)(code >> (31U - n)),
                                   (number)((code << n) & 0x7FFFFFFFUL)};
  return position;
}

static inline table_position locate_gap(const map_type *map, number gap)
{
  return locate_signal(gap, map->gap_segments);
}

static inline table_position locate_force(const map_type *map, number force)
{
  return locate_signal(force, map->force_segments);
}

static inline size_t columns_of(const map_type *map) { return (size_t)1U << map->force_segments; }
static inline size_t rows_of(const map_type *map) { return (size_t)1U << map->gap_segments; }

/* Returns the force at a position in the table. */
static inline number force_at_position(const map_type *map, table_position at)
{
  return (number)((uint32_t)at.index << (31U - map->force_segments)) +
         (at.fraction >> map->force_segments);
}

static inline int is_shape_valid(const map_type *map)
{
  return map->entries != NULL && map->force_segments <= ANHYST_MAP_FORCE_SEGMENTS &&
         map->gap_segments <= ANHYST_MAP_GAP_SEGMENTS;
}

/* Returns a*f, rounded down, with an error of up to 4 LSB. */
static inline number times_fraction(number a, number f) { return anhyst_times_fraction(a, f); }

/* Interpolates linearly between two entries. */
static inline number interpolate(entry from, entry to, number fraction)
{
  const int16_t rise = (int16_t)((int32_t)to - from);
  return (number)from * 65536 + 2 * anhyst_scale(fraction, rise);
}

/* Returns numerator/denominator, rounded down. Requires 0 < numerator < denominator. */
static inline number quotient_below_one(number numerator, number denominator)
{
  return anhyst_ratio(numerator, denominator);
}

#define ONE ANHYST_Q31_MAX

#endif
