/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map_real.h"

#include <stddef.h>

typedef float number;
typedef anhyst_map_f32 map_type;

#include "generic/map_real.h"

#include "generic/map.h"

anhyst_status anhyst_map_check_f32(const anhyst_map_f32 *map)
{
  return is_map_valid(map) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

float anhyst_map_value_f32(const anhyst_map_f32 *map, float force, float gap)
{
  return map_value(map, force, gap);
}

float anhyst_map_force_f32(const anhyst_map_f32 *map, float value, float gap)
{
  return map_force(map, value, gap);
}
