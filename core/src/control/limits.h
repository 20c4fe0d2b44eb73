/* SPDX-License-Identifier: Apache-2.0 */
/* Limits and grid of a converter's currents, in fixed point. */
#ifndef ANHYST_CONTROL_LIMITS_H
#define ANHYST_CONTROL_LIMITS_H

#include "anhyst/numeric/fixed.h"

/* The distance between two numbers in order, which may be beyond an int32_t. */
static uint32_t distance(int32_t low, int32_t high) { return (uint32_t)high - (uint32_t)low; }

/* Whether they are in order and a whole number of steps apart, so that no rounded current is beyond
   a limit; a step of 0: there is no grid. */
static int are_on_grid(int32_t low, int32_t high, int32_t step)
{
  return low <= high && step >= 0 && (step == 0 || distance(low, high) % (uint32_t)step == 0U);
}

static int32_t within(int32_t a, int32_t low, int32_t high) { return anhyst_clamp(a, low, high); }

/* The nearest of the converter's currents, for one within the limits. */
static int32_t on_grid(int32_t current, int32_t low, int32_t high, int32_t grid)
{
  const uint32_t step = (uint32_t)grid;
  const uint32_t above = distance(low, current);
  const uint32_t rest = above % step;
  const uint32_t reached = rest >= step - rest ? above - rest + step : above - rest;
  (void)high; /* a whole number of steps away */
  return (int32_t)((uint32_t)low + reached);
}

#endif
