/* SPDX-License-Identifier: Apache-2.0 */
#include "services/thermal.h"

#define MIN_MANTISSA ((uint32_t)536870912) /* smallest mantissa, 2^29 */

/* Returns the square of a current of either sign, at most 2^62. */
static uint64_t squared_size(int32_t current)
{
  const uint64_t magnitude = current < 0 ? (uint64_t)(-(int64_t)current) : (uint64_t)current;
  return magnitude * magnitude;
}

int thermal_prepare(thermal_plan *plan, uint32_t ticks, int32_t trip_current, int32_t clear_current)
{
  if (ticks < 2U || clear_current <= 0 || trip_current <= clear_current) {
    return 0;
  }
  /* Computes 2^bits/ticks by long division, until the quotient has 30 bits. */
  uint32_t quotient = 0;
  uint64_t remainder = 1;
  uint16_t bits = 0;
  while (quotient < MIN_MANTISSA) {
    remainder <<= 1;
    quotient <<= 1;
    bits++;
    if (remainder >= ticks) {
      remainder -= ticks;
      quotient++;
    }
  }
  plan->mantissa = quotient;
  plan->shift = (uint16_t)(bits - 30U);
  plan->trip_warmth = squared_size(trip_current);
  plan->clear_warmth = squared_size(clear_current);
  return 1;
}

void thermal_start(thermal *t, const thermal_plan *plan)
{
  t->warmth = plan->clear_warmth;
  t->tripped = 0;
}

/* Returns the change of warmth in one tick, share*difference. The product is below 2^63. */
static uint64_t scale_by_share(const thermal_plan *plan, uint64_t difference)
{
  return ((difference >> 30) * plan->mantissa) >> plan->shift;
}

int thermal_tick(thermal *t, const thermal_plan *plan, int32_t current)
{
  const uint64_t squared_current = squared_size(current);
  if (squared_current >= t->warmth) {
    t->warmth += scale_by_share(plan, squared_current - t->warmth);
  } else {
    t->warmth -= scale_by_share(plan, t->warmth - squared_current);
  }
  if (t->warmth > plan->trip_warmth) {
    t->tripped = 1;
  } else if (t->warmth < plan->clear_warmth) {
    t->tripped = 0;
  } else {
    /* between the two limits, the result does not change */
  }
  return t->tripped;
}
