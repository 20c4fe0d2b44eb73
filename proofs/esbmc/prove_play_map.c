/* SPDX-License-Identifier: Apache-2.0 */
/* The map with one play in fixed point: its columns, what its check bounds, what the play adds. */
#include "any.h"

#include "compensator/play_map.c"

int main(void)
{
#if defined(COLUMNS)
  anhyst_map_q31 map = {0, nondet_u16(), 0};
  ASSUME(map.force_segments <= ANHYST_MAP_FORCE_SEGMENTS);
  const uint16_t column = nondet_u16();
  ASSUME(column <= columns_of(&map));
  const int32_t force = force_of(&map, column);
  SHOW(force >= 0);
  SHOW(column == columns_of(&map) || column_of(&map, force) == column);
  SHOW(column_of(&map, any_within(0, ANHYST_Q31_MAX)) < columns_of(&map));
#elif defined(ROW)
  const int16_t entries[2] = {nondet_i16(), nondet_i16()};
  const int16_t half[2] = {nondet_i16(), nondet_i16()};
  ASSUME(row_is_valid(entries, half, 2));
  SHOW(half[0] >= 0 && half[1] >= 0);
  SHOW(entries[1] + half[1] >= entries[0] + half[0]);
  SHOW(entries[1] - half[1] >= entries[0] - half[0]);
#else
  anhyst_play_law_q31 law;
  law.radius = any_within(ANHYST_PLAY_LEAST_RADIUS, ANHYST_Q31_MAX);
  law.steepness.mantissa = (int16_t)any_within(1, 32767);
  law.steepness.shift = (int16_t)any_within(ANHYST_FACTOR_SHIFT_LOW, ANHYST_FACTOR_SHIFT_HIGH);
  const int32_t over = nondet_i32();
  const int32_t size = anhyst_abs_q31(over);
  ASSUME(size >= law.radius); /* below it stands anhyst_share, whose products are another matter */
  const int32_t half = any_within(-8, ANHYST_Q31_MAX);
  const int32_t found = pull(&law, half, over);
  SHOW(found == (over < 0 ? -half : half));
#endif
  return 0;
}
