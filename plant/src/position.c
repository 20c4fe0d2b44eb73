/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/position.h"

#include <math.h>

#define Q31_ONE 2147483648.0

/* Rounds to the nearest q31; NaN becomes 0. */
static int32_t to_code_q31(double value, double full)
{
  const double place = floor(value / full * Q31_ONE + 0.5);
  if (isnan(place)) {
    return 0;
  }
  if (place >= Q31_ONE) {
    return ANHYST_Q31_MAX;
  }
  return place <= -Q31_ONE ? ANHYST_Q31_MIN : (int32_t)place;
}

/* Converts a measured current. The port sends q30, so that a current can exceed full scale. */
static int32_t current_to_code_q31(double value, double full)
{
  const int32_t half = to_code_q31(value, 2.0 * full);
  return anhyst_shl_q31(half, 1);
}

static int32_t flux_to_code_q31(double value, double full)
{
  return isnan(value) ? ANHYST_NO_FLUX : to_code_q31(value, full);
}

static double from_code_q31(int32_t code, double full) { return (double)code / Q31_ONE * full; }

#include "anhyst/numeric/q31.h"
#include "generic/position.h"
#include "anhyst/numeric/f64.h"
#include "generic/cast.h"
#include "generic/position.h"
#include "anhyst/numeric/f32.h"
#include "generic/cast.h"
#include "generic/position.h"
