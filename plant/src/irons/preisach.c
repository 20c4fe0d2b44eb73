/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stddef.h>

#include "anhyst_plant/search.h"

typedef struct {
  int node;     /* index of the node below x; never the last node */
  double share; /* fraction of the interval between the two nodes, 0..1 */
  double slope; /* slope of the node position, nodes per A/m */
} position;

static position locate_node(const anhyst_plant_preisach_steel *steel, double x)
{
  const double last = (double)(steel->nodes - 1);
  const double scale = last / (2.0 * steel->reach);
  const double sum = fabs(x) + steel->knee;
  const double place = (x / sum + steel->reach) * scale;
  position found;
  if (place > 0.0 && place < last) {
    found.node = (int)place;
    found.share = place - (double)found.node;
    found.slope = scale * steel->knee / (sum * sum);
  } else {
    found.node = place > 0.0 ? steel->nodes - 2 : 0;
    found.share = place > 0.0 ? 1.0 : 0.0;
    found.slope = 0.0;
  }
  return found;
}

/* Change of the relays' polarisation on a path, T, and derivatives over both ends, T per node. */
typedef struct {
  double change;
  double by_begin;
  double by_end;
} everett;

static everett interpolate_everett(const anhyst_plant_preisach_steel *steel, position from,
                                   position to)
{
  const double *row = steel->everett + (size_t)from.node * (size_t)steel->nodes + to.node;
  const double *next = row + steel->nodes;
  const double value_at_begin = row[0] + to.share * (row[1] - row[0]);
  const double value_at_next = next[0] + to.share * (next[1] - next[0]);
  everett found;
  found.by_begin = value_at_next - value_at_begin;
  found.change = value_at_begin + from.share * found.by_begin;
  found.by_end = (1.0 - from.share) * (row[1] - row[0]) + from.share * (next[1] - next[0]);
  return found;
}

/* Returns whether the present path rises: away from the last reversal, or from the origin. */
static int is_rising(const anhyst_plant_memory *memory)
{
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const int turns = own->turns;
  if (turns <= 0) {
    return memory->at > 0.0;
  }
  return own->turn[turns - 1].at < (turns > 1 ? own->turn[turns - 2].at : 0.0);
}

/* Returns the number of reversal points after a monotone path to x. If the path starts with a
   reversal, the present field is one of them. */
static int count_reversals(const anhyst_plant_memory *memory, double x)
{
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const double way = x - memory->at;
  const int is_upward = way > 0.0;
  int turns = own->turns;
  if (way == 0.0) {
    return turns;
  }
  if (is_upward != is_rising(memory) && !(turns == 0 && memory->at == 0.0)) {
    if (turns < ANHYST_PLANT_MAX_REVERSALS) {
      turns++;
    } else if (is_upward ? x <= own->turn[turns - 1].at : x >= own->turn[turns - 1].at) {
      return turns; /* the memory is full: the path returns on the same branch */
    } else {
      turns--;
    }
  }
  while (turns > 0) {
    const double outermost = own->turns > 0 ? own->turn[0].at : memory->at;
    const double limit = turns > 1 ? own->turn[turns - 2].at : -outermost;
    if (is_upward ? x < limit : x > limit) {
      break;
    }
    turns = turns > 1 ? turns - 2 : 0;
  }
  return turns;
}

static inline void evaluate_goal(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                                 anhyst_plant_goal *goal)
{
  const anhyst_plant_preisach_steel *steel = &iron->steel.preisach;
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const int turns = count_reversals(memory, goal->at);
  const position end = locate_node(steel, goal->at);
  double slope;
  double polarisation = anhyst_plant_polarisation(&steel->curve, goal->at, &slope);
  double relays;
  if (turns > 0) {
    const int is_reversed = turns > own->turns;
    const double from = is_reversed ? memory->at : own->turn[turns - 1].at;
    const everett way = interpolate_everett(steel, locate_node(steel, from), end);
    relays = (is_reversed ? own->relays : own->turn[turns - 1].relays) + way.change;
    slope += end.slope * way.by_end;
  } else {
    const everett way = interpolate_everett(steel, locate_node(steel, -goal->at), end);
    relays = 0.5 * way.change;
    slope += 0.5 * end.slope * (way.by_end - way.by_begin);
  }
  polarisation += relays;
  goal->own.preisach.turns = turns;
  goal->own.preisach.relays = relays;
  goal->field = goal->at - steel->feedback * polarisation;
  goal->field_slope = 1.0 - steel->feedback * slope;
  goal->density = ANHYST_PLANT_MU0 * goal->field + polarisation;
  goal->density_slope = ANHYST_PLANT_MU0 * goal->field_slope + slope;
}

static void move(const anhyst_plant_iron *iron, anhyst_plant_memory *memory,
                 const anhyst_plant_goal *goal)
{
  anhyst_plant_preisach *own = &memory->own.preisach;
  const int turns = goal->own.preisach.turns;
  (void)iron;
  if (turns > own->turns) {
    own->turn[turns - 1].at = memory->at;
    own->turn[turns - 1].relays = own->relays;
  }
  own->turns = turns;
  own->relays = goal->own.preisach.relays;
  memory->density = goal->density;
}

ANHYST_PLANT_DEFINE_FAMILY(preisach);
