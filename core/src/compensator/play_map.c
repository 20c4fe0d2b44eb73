/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map.h"

#include "anhyst/numeric/q31.h"

#include <stddef.h>

#include "lookup.h"

/* Whether a row with its half-widths never falls and stays within the format. */
static int row_is_valid(const int16_t *entries, const int16_t *half, uint16_t columns)
{
  for (uint16_t i = 0; i < columns; i++) {
    if (half[i] < 0 || (int32_t)entries[i] + half[i] > ANHYST_Q15_MAX ||
        (int32_t)entries[i] - half[i] < -ANHYST_Q15_MAX) {
      return 0;
    }
    if (i > 0U) {
      const int32_t rise = (int32_t)entries[i] - entries[i - 1U];
      const int32_t wider = (int32_t)half[i] - half[i - 1U];
      if (wider > rise || -wider > rise) {
        return 0;
      }
    }
  }
  return 1;
}

anhyst_status anhyst_play_law_check_q31(const anhyst_play_law_q31 *law)
{
  const anhyst_map_q31 *map = &law->map;
  if (anhyst_map_check_q31(map) != ANHYST_OK || law->half.entries == NULL ||
      law->half.force_segments != map->force_segments ||
      law->half.gap_segments != map->gap_segments || law->radius < ANHYST_PLAY_LEAST_RADIUS ||
      !anhyst_factor_is_valid(law->steepness) || law->steepness.mantissa <= 0) {
    return ANHYST_BAD_PARAMETER;
  }
  const uint16_t columns = (uint16_t)(((uint32_t)1U << map->force_segments) + 1U);
  const uint16_t rows = (uint16_t)(((uint32_t)1U << map->gap_segments) + 1U);
  for (uint16_t row = 0; row < rows; row++) {
    const size_t first = (size_t)row * columns;
    if (!row_is_valid(map->entries + first, law->half.entries + first, columns)) {
      return ANHYST_BAD_PARAMETER;
    }
  }
  return ANHYST_OK;
}

static int is_known(int32_t a)
{
  (void)a;
  return 1; /* every code is a number */
}

static int32_t limited(int32_t a, int32_t low, int32_t high) { return anhyst_clamp(a, low, high); }

/* The nearest force of the map, which only pulls; the largest code is its last column. */
static int32_t pulling(const anhyst_map_q31 *map, int32_t demand)
{
  (void)map;
  return demand > 0 ? demand : 0;
}

/* half*bounded(over/radius); exact from radius on. */
static int32_t pull(const anhyst_play_law_q31 *law, int32_t half, int32_t over)
{
  const int32_t size = anhyst_abs_q31(over);
  int32_t part = half;
  if (size < law->radius) {
    part = anhyst_share(half, anhyst_shl_q31(anhyst_factor_product(size, law->steepness), 2));
  }
  return over < 0 ? -part : part;
}

static uint16_t columns_of(const anhyst_map_q31 *map)
{
  return (uint16_t)((uint32_t)1U << map->force_segments);
}

/* The column at or below a force. */
static uint16_t column_of(const anhyst_map_q31 *map, int32_t force)
{
  return (uint16_t)((uint32_t)force >> (31U - map->force_segments));
}

/* The largest code is the last column. */
static int32_t force_of(const anhyst_map_q31 *map, uint16_t column)
{
  const uint32_t force = (uint32_t)column << (31U - map->force_segments);
  return force > (uint32_t)ANHYST_Q31_MAX ? ANHYST_Q31_MAX : (int32_t)force;
}

/* Where a straight line between two forces is as far above the one as below the other, to 14 bits;
   both parts above 0. */
static int32_t between(int32_t low, int32_t high, int32_t below, int32_t above)
{
  const int32_t whole = (below >> 1) + (above >> 1) + 1;
  const int32_t share = anhyst_quotient((below >> 1) + (below & 1), whole);
  return low + anhyst_share(high - low, anhyst_shl_q31(share, 15));
}

/* Whether so much of a current is rounding. */
static int is_nothing(const anhyst_play_map_q31 *c, int32_t current)
{
  (void)c;
  return current <= ANHYST_PLAY_NEAR && current >= -ANHYST_PLAY_NEAR;
}

#include "generic/play_map.h"
