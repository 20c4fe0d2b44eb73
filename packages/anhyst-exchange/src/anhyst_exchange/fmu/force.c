/* SPDX-License-Identifier: Apache-2.0 */
/* An actuator whose armature is moved from outside, and the compensator that controls its force:
 * the virtual plant and the fixed-point C of the controller in lock-step, as `anhyst force-control`
 * runs them, from demagnetised iron. The compensator is compiled separately (compensator.c),
 * because it and the plant define the state of a hysteresis law differently. */
#include "anhyst_plant/held.h"

#include <math.h>

#include "force_numbers.h"
#include "part.h"

#define COMPENSATOR_DOUBLES 64 /* doubles that are reserved for the state of the compensator */
#define GAP_CODES 1073741824.0 /* sensor codes of the gap over its range */

enum { DEMAND = 1, GAP, NOISE, COMMAND = NOISE + ANHYST_HELD_SENSORS, CURRENT, FORCE, READ };

extern const anhyst_part anhyst_compensator_part;

typedef struct {
  anhyst_plant_held_state plant;
  anhyst_plant_memory volume[FORCE_VOLUMES];
  double compensator[COMPENSATOR_DOUBLES];
} state_of;

static void relink(const void *tables, void *state)
{
  state_of *now = (state_of *)state;
  now->plant.coil.volume = now->volume;
  anhyst_compensator_part.relink(tables, now->compensator);
}

static int start(const void *tables, void *state, double *values)
{
  state_of *now = (state_of *)state;
  double signals[4] = {0.0};
  (void)values;
  now->plant.coil.volume = now->volume;
  return anhyst_compensator_part.state <= sizeof now->compensator
             ? anhyst_compensator_part.start(tables, now->compensator, signals)
             : -1;
}

/* Returns the gap as the compensator of a firmware gets it, rounded to the codes of its sensor. */
static double quantise_gap(double gap)
{
  const double share = anhyst_plant_limit_to_range(
      (gap - FORCE_GAP_LOW) / (FORCE_GAP_HIGH - FORCE_GAP_LOW), 0.0, 1.0);
  return FORCE_GAP_LOW +
         (FORCE_GAP_HIGH - FORCE_GAP_LOW) * (floor(share * GAP_CODES + 0.5) / GAP_CODES);
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  double signals[4] = {0.0, values[DEMAND]};
  if (!(values[GAP] >= 1e-9 && values[GAP] <= 1.0)) { /* such a gap would corrupt the state */
    return "a gap is from 1e-9 to 1 m";
  }
  anhyst_plant_held_tick(&force_held, &now->plant, values[COMMAND], values[GAP], values + NOISE,
                         values + CURRENT);
  if (FORCE_HAS_GAP) {
    signals[2] = quantise_gap(values[READ + ANHYST_HELD_GAP]);
  }
  (void)anhyst_compensator_part.tick(tables, now->compensator, signals, seconds);
  values[COMMAND] = signals[2 + FORCE_HAS_GAP];
  return NULL;
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), NULL, NULL, relink, start, tick};
