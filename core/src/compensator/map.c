/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map.h"

#include "map_fixed.h"

#include "generic/map.h"

anhyst_status anhyst_map_check_q31(const anhyst_map_q31 *map)
{
  return is_map_valid(map) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

int32_t anhyst_map_value_q31(const anhyst_map_q31 *map, int32_t force, int32_t gap)
{
  return map_value(map, force, gap);
}

int32_t anhyst_map_force_q31(const anhyst_map_q31 *map, int32_t value, int32_t gap)
{
  return map_force(map, value, gap);
}
