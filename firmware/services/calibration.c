/* SPDX-License-Identifier: Apache-2.0 */
#include "services/calibration.h"

/* Compile-time check that a right shift keeps the sign; C99 leaves this to the compiler. */
typedef char calibration_shift_keeps_the_sign[((int64_t)-3 >> 1) == -2 ? 1 : -1];

int calibration_is_valid(const calibration *c)
{
  return c->mantissa != 0 && c->mantissa >= -CALIBRATION_MAX_MANTISSA &&
         c->mantissa <= CALIBRATION_MAX_MANTISSA && c->shift >= 0 &&
         c->shift <= CALIBRATION_MAX_SHIFT && c->low < c->high;
}

int32_t calibration_value(const calibration *c, int32_t code)
{
  int32_t value = CALIBRATION_NONE;
  if (code >= c->low && code <= c->high) {
    /* The difference is below 2^32 and the mantissa at most 2^30, so the sum is below 2^63. */
    const int64_t product = ((int64_t)code - c->zero) * c->mantissa;
    const int64_t half = c->shift > 0 ? (int64_t)1 << (c->shift - 1) : 0;
    const int64_t rounded = (product + half) >> c->shift;
    if (rounded > INT32_MAX) {
      value = INT32_MAX;
    } else if (rounded < -INT32_MAX) {
      value = -INT32_MAX;
    } else {
      value = (int32_t)rounded;
    }
  }
  return value;
}
