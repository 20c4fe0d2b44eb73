/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/search.h"

/* A cell at the edge of its play counts as moving. Therefore, the slope at the present field is
   that of a movement in the last direction. */
static inline void evaluate_goal(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                                 anhyst_plant_goal *goal)
{
  const anhyst_plant_cell_steel *steel = &iron->steel.cells;
  const anhyst_plant_cells *cells = &memory->own.cells;
  anhyst_plant_cells_goal *result = &goal->own.cells;
  const double at = goal->at;
  double density = ANHYST_PLANT_MU0 * at;
  double slope = ANHYST_PLANT_MU0;
  int i;
  for (i = 0; i < steel->cells; i++) {
    const double distance = at - cells->place[i];
    const double r = steel->threshold[i];
    double curve_slope;
    double part;
    if (distance < r && distance > -r) {
      break;
    }
    part = steel->weight[i] *
           anhyst_plant_polarisation(&steel->curve, at - copysign(r, distance), &curve_slope);
    result->part[i] = part;
    density += part;
    slope += steel->weight[i] * curve_slope;
  }
  result->moved = i;
  goal->field = at;
  goal->field_slope = 1.0;
  goal->density = density + cells->rest[i];
  goal->density_slope = slope;
}

static void move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                 const anhyst_plant_goal *goal)
{
  const anhyst_plant_cell_steel *steel = &iron->steel.cells;
  anhyst_plant_cells *cells = &memory->own.cells;
  const double at = goal->at;
  int i = goal->own.cells.moved;
  double rest = cells->rest[i];
  for (i--; i >= 0; i--) {
    const double r = steel->threshold[i];
    rest += goal->own.cells.part[i];
    cells->place[i] = at - copysign(r, at - cells->place[i]);
    cells->rest[i] = rest;
  }
  memory->density = ANHYST_PLANT_MU0 * at + rest;
}

ANHYST_PLANT_DEFINE_FAMILY(cells);
