/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/iron.h"

void anhyst_plant_field(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory, double a,
                        double b, double r, double tolerance, const anhyst_plant_beyond *beyond,
                        anhyst_plant_goal *goal)
{
  iron->family->field(iron, memory, a, b, r, tolerance, beyond, goal);
}

void anhyst_plant_move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                       const anhyst_plant_goal *goal)
{
  iron->family->move(iron, memory, goal);
  memory->stride = goal->at - memory->at;
  memory->at = goal->at;
  memory->field = goal->field;
}
