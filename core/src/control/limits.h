/* SPDX-License-Identifier: Apache-2.0 */
/* Limits and grid of the currents of a D/A converter, in fixed point. */
#ifndef ANHYST_CONTROL_LIMITS_H
#define ANHYST_CONTROL_LIMITS_H

#include "anhyst/numeric/fixed.h"

/* Returns high - low, which may exceed an int32_t. Requires low <= high. */
static uint32_t current_range(int32_t low, int32_t high) { return (uint32_t)high - (uint32_t)low; }

/* Returns whether low <= high and the range is an integer number of steps, so that no rounded
   current exceeds a limit. A step of 0 means that there is no grid. */
static int is_range_on_grid(int32_t low, int32_t high, int32_t step)
{
  return low <= high && step >= 0 && (step == 0 || current_range(low, high) % (uint32_t)step == 0U);
}

static int32_t clamp(int32_t a, int32_t low, int32_t high) { return anhyst_clamp(a, low, high); }

/* Rounds a current within the limits to the nearest value of the D/A converter. */
static int32_t round_to_grid(int32_t current, int32_t low, int32_t high, int32_t grid)
{
  const uint32_t step = (uint32_t)grid;
  const uint32_t offset = current_range(low, current);
  const uint32_t remainder = offset % step;
  const uint32_t rounded =
      remainder >= step - remainder ? offset - remainder + step : offset - remainder;
  (void)high; /* above `low` by an integer number of steps */
  return (int32_t)((uint32_t)low + rounded);
}

#endif
