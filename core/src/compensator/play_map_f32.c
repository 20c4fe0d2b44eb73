/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/play_map_real.h"

#include <stddef.h>

#include "anhyst/compensator/map.h"
#include "checksum.h"

typedef float number;
typedef uint32_t pattern; /* unsigned integer with the size of a number */
typedef anhyst_map_f32 map_type;
typedef anhyst_play_law_f32 law_type;
typedef anhyst_play_point_f32 point;
typedef anhyst_play_map_f32 play_type;

#define MACHINE_EPSILON 1.1920929e-7f /* distance from 1 to the next larger number */

#include "generic/map_real.h"
#include "generic/play_map_real.h"
#include "generic/map.h"
#include "generic/play_block.h"
#include "generic/play_map.h"

anhyst_status anhyst_play_map_init_f32(anhyst_play_map_f32 *c, const float *words,
                                       uint16_t capacity)
{
  return init_play_map(c, words, capacity);
}

float anhyst_play_map_solve_f32(anhyst_play_map_f32 *c, float demand, float gap)
{
  return solve_demand(c, demand, gap);
}

float anhyst_play_map_commit_f32(anhyst_play_map_f32 *c, float applied, float gap)
{
  return commit_current(c, applied, gap);
}
