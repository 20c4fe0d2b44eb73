/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stddef.h>

#include "anhyst_plant/search.h"

/* Where an effective field lies among the nodes. */
typedef struct {
  int node;     /* the one below, of two */
  double share; /* of the way to the next */
  double slope; /* nodes for each A/m */
} spot;

static spot spot_of(const anhyst_plant_preisach_steel *steel, double x)
{
  const double last = (double)(steel->nodes - 1);
  const double scale = last / (2.0 * steel->reach);
  const double around = fabs(x) + steel->knee;
  const double place = (x / around + steel->reach) * scale;
  spot found;
  if (place > 0.0 && place < last) {
    found.node = (int)place;
    found.share = place - (double)found.node;
    found.slope = scale * steel->knee / (around * around);
  } else {
    found.node = place > 0.0 ? steel->nodes - 2 : 0;
    found.share = place > 0.0 ? 1.0 : 0.0;
    found.slope = 0.0;
  }
  return found;
}

/* By which the relays change on the way from one to the other, T; and the slopes there by either
   end, T for each node. */
typedef struct {
  double change;
  double by_begin;
  double by_end;
} everett;

static everett between(const anhyst_plant_preisach_steel *steel, spot from, spot to)
{
  const double *row = steel->everett + (size_t)from.node * (size_t)steel->nodes + to.node;
  const double *next = row + steel->nodes;
  const double here = row[0] + to.share * (row[1] - row[0]);
  const double there = next[0] + to.share * (next[1] - next[0]);
  everett found;
  found.by_begin = there - here;
  found.change = here + from.share * found.by_begin;
  found.by_end = (1.0 - from.share) * (row[1] - row[0]) + from.share * (next[1] - next[0]);
  return found;
}

/* The way on which it stands leads up: away from the last turn, or from the origin. */
static int leads_up(const anhyst_plant_memory *memory)
{
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const int turns = own->turns;
  if (turns <= 0) {
    return memory->at > 0.0;
  }
  return own->turn[turns - 1].at < (turns > 1 ? own->turn[turns - 2].at : 0.0);
}

/* Turning points that are left after a straight way to x; one more than there are if it turns
   where it stands. */
static int turns_left(const anhyst_plant_memory *memory, double x)
{
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const double way = x - memory->at;
  const int up = way > 0.0;
  int left = own->turns;
  if (way == 0.0) {
    return left;
  }
  if (up != leads_up(memory) && !(left == 0 && memory->at == 0.0)) {
    if (left < ANHYST_PLANT_TURNS) {
      left++;
    } else if (up ? x <= own->turn[left - 1].at : x >= own->turn[left - 1].at) {
      return left; /* full: back on the same branch */
    } else {
      left--;
    }
  }
  while (left > 0) {
    const double outermost = own->turns > 0 ? own->turn[0].at : memory->at;
    const double limit = left > 1 ? own->turn[left - 2].at : -outermost;
    if (up ? x < limit : x > limit) {
      break;
    }
    left = left > 1 ? left - 2 : 0;
  }
  return left;
}

static inline void look(const anhyst_plant_iron *iron, const anhyst_plant_memory *memory,
                        anhyst_plant_goal *goal)
{
  const anhyst_plant_preisach_steel *steel = &iron->steel.preisach;
  const anhyst_plant_preisach *own = &memory->own.preisach;
  const int left = turns_left(memory, goal->at);
  const spot end = spot_of(steel, goal->at);
  double slope;
  double polarisation = anhyst_plant_polarisation(&steel->curve, goal->at, &slope);
  double relays;
  if (left > 0) {
    const int turned = left > own->turns;
    const double from = turned ? memory->at : own->turn[left - 1].at;
    const everett way = between(steel, spot_of(steel, from), end);
    relays = (turned ? own->relays : own->turn[left - 1].relays) + way.change;
    slope += end.slope * way.by_end;
  } else {
    const everett way = between(steel, spot_of(steel, -goal->at), end);
    relays = 0.5 * way.change;
    slope += 0.5 * end.slope * (way.by_end - way.by_begin);
  }
  polarisation += relays;
  goal->own.preisach.turns = left;
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
  const int left = goal->own.preisach.turns;
  (void)iron;
  if (left > own->turns) {
    own->turn[left - 1].at = memory->at;
    own->turn[left - 1].relays = own->relays;
  }
  own->turns = left;
  own->relays = goal->own.preisach.relays;
  memory->density = goal->density;
}

ANHYST_PLANT_FAMILY(preisach);
