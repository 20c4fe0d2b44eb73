/* SPDX-License-Identifier: Apache-2.0 */

#define ANHYST_PLAY_STEPS 12 /* within a segment: more digits than fixed point */

anhyst_status anhyst_play_law_check_x(const anhyst_play_law_x *law)
{
  const anhyst_map_x *map = &law->map;
  const anhyst_map_x *half = &law->half;
  if (anhyst_map_check_x(map) != ANHYST_OK || half->entries == 0 ||
      half->force_segments != map->force_segments || half->gap_segments != map->gap_segments ||
      half->force_low != map->force_low || half->force_high != map->force_high ||
      half->gap_low != map->gap_low || half->gap_high != map->gap_high ||
      !(law->radius > R(0.0) && law->radius <= R(1e30))) {
    return ANHYST_BAD_PARAMETER;
  }
  const size_t columns = (size_t)map->force_segments + 1U;
  const size_t entries = columns * ((size_t)map->gap_segments + 1U);
  for (size_t i = 0; i < entries; i++) {
    if (!(half->entries[i] >= R(0.0) && half->entries[i] <= R(1e30))) {
      return ANHYST_BAD_PARAMETER;
    }
    if (i % columns != 0U) {
      const ANHYST_REAL rise = map->entries[i] - map->entries[i - 1U];
      const ANHYST_REAL wider = half->entries[i] - half->entries[i - 1U];
      if (!(wider <= rise && -wider <= rise)) {
        return ANHYST_BAD_PARAMETER;
      }
    }
  }
  return ANHYST_OK;
}

static int is_known(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

static ANHYST_REAL limited(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  return anhyst_limited_x(a, low, high);
}

/* The nearest force of the map; none where the demand is no number. */
static ANHYST_REAL pulling(const anhyst_map_x *map, ANHYST_REAL demand)
{
  const ANHYST_REAL below = demand < map->force_low ? map->force_low : R(0.0);
  return demand >= map->force_low ? anhyst_limited_x(demand, map->force_low, map->force_high)
                                  : below;
}

/* half*bounded(over/radius). */
static ANHYST_REAL pull(const anhyst_play_law_x *law, ANHYST_REAL half, ANHYST_REAL over)
{
  return half * (anhyst_limited_x(over, -law->radius, law->radius) / law->radius);
}

static uint16_t columns_of(const anhyst_map_x *map) { return map->force_segments; }

/* The column at or below a force; the last but one at most. */
static uint16_t column_of(const anhyst_map_x *map, ANHYST_REAL force)
{
  const ANHYST_REAL place = (force - map->force_low) / (map->force_high - map->force_low) *
                            (ANHYST_REAL)map->force_segments;
  return anhyst_spot_of_x(map->force_segments, place).index;
}

static ANHYST_REAL force_of(const anhyst_map_x *map, uint16_t column)
{
  return map->force_low + (map->force_high - map->force_low) *
                              ((ANHYST_REAL)column / (ANHYST_REAL)map->force_segments);
}

/* Where a straight line between two forces is as far above the one as below the other; both parts
   above 0. */
static ANHYST_REAL between(ANHYST_REAL low, ANHYST_REAL high, ANHYST_REAL below, ANHYST_REAL above)
{
  return low + (high - low) * (below / (below + above));
}

/* Whether so much of a current is rounding. */
static int is_nothing(const anhyst_play_map_x *c, ANHYST_REAL current)
{
  const ANHYST_REAL most = R(4.0) * anhyst_noise_x(c->high - c->low);
  return current <= most && -current <= most;
}
