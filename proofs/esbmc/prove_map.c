/* SPDX-License-Identifier: Apache-2.0 */
/* Proves the map in fixed point: the position of a signal in a table of any size, the force at a
   position, and the digits of the inverse. */
#include "any.h"

#include "compensator/map.c"

int main(void)
{
#ifdef PLACE
  const map_type map = {0, nondet_u16(), 0};
  ASSUME(map.force_segments <= ANHYST_MAP_FORCE_SEGMENTS);
  const int32_t force = nondet_i32();
  const table_position at = locate_force(&map, force);
  SHOW(at.index < columns_of(&map));
  SHOW(at.fraction >= 0);
  SHOW(force_at_position(&map, at) == (force > 0 ? force : 0));
  const table_position end = {columns_of(&map) - 1U, ONE};
  SHOW(force_at_position(&map, end) == ANHYST_Q31_MAX);
#else
  const int32_t whole = any_within(2, ANHYST_Q31_MAX);
  SHOW(anhyst_ratio(any_within(1, whole - 1), whole) >= 0);
#endif
  return 0;
}
