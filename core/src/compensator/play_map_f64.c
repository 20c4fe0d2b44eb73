/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map_real.h"

#include <stddef.h>

#include "anhyst/compensator/map.h"
#include "checksum.h"

typedef double number;
typedef uint64_t pattern; /* unsigned integer with the size of a number */
typedef anhyst_map_f64 map_type;
typedef anhyst_play_law_f64 law_type;
typedef anhyst_play_point_f64 point;
typedef anhyst_play_map_f64 play_type;

#define MACHINE_EPSILON 2.220446049250313e-16 /* distance from 1 to the next larger number */

#include "generic/map_real.h"
#include "generic/play_map_real.h"
#include "generic/map.h"
#include "generic/play_block.h"
#include "generic/play_map.h"

anhyst_status anhyst_play_map_init_f64(anhyst_play_map_f64 *c, const double *words,
                                       uint16_t capacity)
{
  return init_play_map(c, words, capacity);
}

double anhyst_play_map_solve_f64(anhyst_play_map_f64 *c, double demand, double gap)
{
  return solve_demand(c, demand, gap);
}

double anhyst_play_map_commit_f64(anhyst_play_map_f64 *c, double applied, double gap)
{
  return commit_current(c, applied, gap);
}
