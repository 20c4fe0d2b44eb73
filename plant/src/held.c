/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/held.h"

static void step_amplifier(const anhyst_plant_held *held, anhyst_plant_held_state *s,
                           double reference)
{
  const double error = s->reference - held->zero - s->current;
  const double unlimited =
      s->current + anhyst_plant_limit_to_range(held->share * error, -held->most, held->most);
  s->current = unlimited > held->low ? unlimited : held->low;
  s->reference = anhyst_plant_convert(reference, held->low, held->high, held->step);
}

void anhyst_plant_held_tick(const anhyst_plant_held *held, anhyst_plant_held_state *state,
                            double reference, double gap, const double *noise, double *row)
{
  double quantity[ANHYST_HELD_SENSORS];
  int i;
  if (state->begun) { /* the first tick has no previous tick */
    step_amplifier(held, state, reference);
  }
  if (held->seconds > 0.0) {
    anhyst_plant_coil_follow(&held->magnet, &state->coil, state->current, gap, held->seconds);
  } else {
    anhyst_plant_coil_lead(&held->magnet, &state->coil, state->current, gap, 0.0);
  }
  row[0] = quantity[ANHYST_HELD_CURRENT] = state->current;
  row[1] = quantity[ANHYST_HELD_FORCE] = state->coil.force;
  quantity[ANHYST_HELD_GAP] = gap;
  for (i = 0; i < ANHYST_HELD_SENSORS; i++) {
    row[2 + i] = anhyst_plant_sensor_take(&held->sensor[i], &state->sensing[i], !state->begun,
                                          quantity[i], noise[i]);
  }
  state->begun = 1;
}
