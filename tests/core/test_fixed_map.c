/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the map over force and gap in fixed point. The reference is the same table,
   interpolated in double precision, which is sufficiently exact. */
#include "compensator/lookup.h"

#include "check.h"
#include "edges.h"
#include "maps.h"

static const double FULL = 2147483648.0;
static int16_t entries[MOST_COLUMNS * MOST_ROWS];

static double exact_entry(const anhyst_map_q31 *map, double gap, int column)
{
  const int columns = (1 << map->force_segments) + 1;
  const double place = fmax(gap, 0.0) / FULL * (double)(1 << map->gap_segments);
  const int row = (int)place;
  const double low = map->entries[row * columns + column];
  const double high = map->entries[(row + 1) * columns + column];
  return 65536.0 * (low + (place - row) * (high - low));
}

static double exact_value(const anhyst_map_q31 *map, double force, double gap)
{
  const double place = fmax(force, 0.0) / FULL * (double)(1 << map->force_segments);
  const int column = (int)place;
  const double low = exact_entry(map, gap, column);
  return low + (place - column) * (exact_entry(map, gap, column + 1) - low);
}

/* Returns the largest change of the value per unit of the force at this gap. */
static double steepest_slope(const anhyst_map_q31 *map, double gap)
{
  const int segments = 1 << map->force_segments;
  double most = 0.0;
  for (int i = 0; i < segments; i++) {
    most = fmax(most, exact_entry(map, gap, i + 1) - exact_entry(map, gap, i));
  }
  return most * segments / FULL;
}

static void check_values(const anhyst_map_q31 *map, double *worst, double *worst_back)
{
  for (int i = 0; i < SIGNALS; i++) {
    const int32_t force = i < EDGE_COUNT && i % 2 == 0 ? edge_number(i) : any_code();
    const int32_t gap = i % 3 == 0 ? edge_number((7 * i) % EDGE_COUNT) : any_code();
    const int32_t value = anhyst_map_value_q31(map, force, gap);
    keep_largest(worst, fabs((double)value - exact_value(map, (double)force, (double)gap)));

    const double low = exact_entry(map, (double)gap, 0);
    const double high = exact_entry(map, (double)gap, 1 << map->force_segments);
    const int32_t wanted = any_code();
    const int32_t found = anhyst_map_force_q31(map, wanted, gap);
    const double reached = fmin(fmax((double)wanted, low), high);
    const double room = 2.0 * steepest_slope(map, (double)gap);
    keep_largest(worst_back, fabs(exact_value(map, (double)found, (double)gap) - reached) - room);
    CHECK(found >= 0);
  }
}

static void map_interpolation_error_is_a_few_lsb(void)
{
  double worst = 0.0;
  double worst_back = 0.0;
  for (int i = 0; i < 300; i++) {
    const uint16_t n = (uint16_t)(i % 9);
    const uint16_t m = (uint16_t)(i % 7);
    const anhyst_map_q31 map = any_map(entries, n, m, i % 2 == 0 ? 32767 : 65536 >> n);
    check_values(&map, &worst, &worst_back);
  }
  CHECK_BELOW("value of a map, units in the last place", worst, 8.0);
  CHECK_BELOW("value at the inverse, beyond two units of the force", worst_back, 8.0);
}

static void ratio_is_exact_except_for_its_floor(void)
{
  double worst = 0.0;
  for (int i = 0; i < 100000; i++) {
    const int32_t whole = any_within(2, ANHYST_Q31_MAX);
    const int32_t part = any_within(1, whole - 1);
    const double missing = (double)part / (double)whole * FULL - (double)anhyst_ratio(part, whole);
    keep_largest(&worst, fabs(missing - 0.5));
  }
  CHECK_BELOW("ratio, from the middle of a unit in the last place", worst, 0.500001);
}

static void inverse_map_never_falls(void)
{
  const anhyst_map_q31 map = any_map(entries, 5, 3, 3000);
  double worst = 0.0;
  for (int i = 0; i < SIGNALS; i++) {
    const int32_t gap = any_code();
    const int32_t force = any_within(0, ANHYST_Q31_MAX - 1000);
    const int32_t more = force + any_within(0, 1000);
    const double fall = (double)anhyst_map_value_q31(&map, force, gap) -
                        (double)anhyst_map_value_q31(&map, more, gap);
    keep_largest(&worst, fall);
  }
  CHECK_BELOW("fall of the value, units in the last place", worst, 4.0);
}

static void invalid_maps_are_refused(void)
{
  const anhyst_map_q31 valid = any_map(entries, 3, 2, 1000);
  anhyst_map_q31 map = valid;
  map.force_segments = 9;
  CHECK(anhyst_map_check_q31(&map) == ANHYST_BAD_PARAMETER);
  map = valid;
  map.gap_segments = 7;
  CHECK(anhyst_map_check_q31(&map) == ANHYST_BAD_PARAMETER);
  map = valid;
  map.entries = 0;
  CHECK(anhyst_map_check_q31(&map) == ANHYST_BAD_PARAMETER);
  const int16_t falling[] = {0, 5, 0, -1};
  const int16_t far_over_gap[] = {-20000, -19000, 20000, 20001};
  const int16_t least[] = {-32767 - 1, 0, 0, 1};
  const int16_t *const wrong[] = {falling, far_over_gap, least};
  for (int i = 0; i < 3; i++) {
    const anhyst_map_q31 bad = {wrong[i], 0, 0};
    CHECK(anhyst_map_check_q31(&bad) == ANHYST_BAD_PARAMETER);
  }
}

int main(void)
{
  map_interpolation_error_is_a_few_lsb();
  ratio_is_exact_except_for_its_floor();
  inverse_map_never_falls();
  invalid_maps_are_refused();
  return verdict();
}
