/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/map_real.h"

#include <stddef.h>

typedef double number;
typedef anhyst_map_f64 map_type;

#include "generic/map_real.h"

#include "generic/map.h"

anhyst_status anhyst_map_check_f64(const anhyst_map_f64 *map)
{
  return is_map_valid(map) ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

double anhyst_map_value_f64(const anhyst_map_f64 *map, double force, double gap)
{
  return map_value(map, force, gap);
}

double anhyst_map_force_f64(const anhyst_map_f64 *map, double value, double gap)
{
  return map_force(map, value, gap);
}
