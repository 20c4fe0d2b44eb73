/* SPDX-License-Identifier: Apache-2.0 */
#include "component.h"

#include <math.h>

#include "actuator.h"

#define ONE_Q31 2147483648.0
#define ROUNDING 1e-6 /* of a tick: times are sums of steps */

int anhyst_component_start(anhyst_component *component)
{
  component->inputs[0] = 0.0;
  component->inputs[1] = ACTUATOR_GAP_LOW;
  component->current = 0.0;
  component->start = 0.0;
  component->time = 0.0;
  component->ticks = 0.0;
  return anhyst_compensator_init(&component->compensator, &ACTUATOR_KERNEL, actuator_parameters,
                                 ACTUATOR_WORDS) == ANHYST_OK
             ? 0
             : -1;
}

/* A signal as a fraction in q31, to the nearest; beyond its ends the ends. */
static int32_t code_of(double fraction)
{
  const double scaled = rint(fraction * ONE_Q31);
  if (!(scaled > -ONE_Q31)) {
    return INT32_MIN;
  }
  return scaled < ONE_Q31 ? (int32_t)scaled : INT32_MAX;
}

static void tick(anhyst_component *component)
{
  const double span = ACTUATOR_GAP_HIGH - ACTUATOR_GAP_LOW;
  const double place = span > 0.0 ? (component->inputs[1] - ACTUATOR_GAP_LOW) / span : 0.0;
  const int32_t gap = code_of(place);
  const int32_t demand = code_of(component->inputs[0] / ACTUATOR_FULL_SCALE_DEMAND);
  const int32_t current = anhyst_compensator_solve_q31(&component->compensator, demand, gap);
  anhyst_compensator_commit_q31(&component->compensator, current, gap);
  component->current = (double)current / ONE_Q31 * ACTUATOR_FULL_SCALE_CURRENT;
}

void anhyst_component_advance(anhyst_component *component, double until)
{
  while ((until - component->start) * ACTUATOR_RATE > component->ticks + ROUNDING) {
    tick(component);
    component->ticks += 1.0;
  }
  component->time = until;
}

void anhyst_component_restore(anhyst_component *component, const anhyst_component *from)
{
  const anhyst_kernel *kernel = component->compensator.kernel;
  const int16_t *words = component->compensator.words;
  *component = *from;
  component->compensator.kernel = kernel;
  component->compensator.words = words;
}

int anhyst_component_get(const anhyst_component *component, unsigned reference, double *value)
{
  switch (reference) {
  case VARIABLE_TIME:
    *value = component->time;
    return 0;
  case VARIABLE_DEMAND:
  case VARIABLE_GAP:
    *value = component->inputs[reference - VARIABLE_DEMAND];
    return 0;
  case VARIABLE_CURRENT:
    *value = component->current;
    return 0;
  default:
    return -1;
  }
}

int anhyst_component_set(anhyst_component *component, unsigned reference, double value)
{
  if (reference != VARIABLE_DEMAND && reference != VARIABLE_GAP) {
    return -1;
  }
  component->inputs[reference - VARIABLE_DEMAND] = value;
  return 0;
}
