/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolation in tables of a parameter block, quotients for Newton steps, exact ratios. */
#ifndef ANHYST_LOOKUP_H
#define ANHYST_LOOKUP_H

#include "anhyst/numeric/fixed.h"

/* maximum slope, in units of 1/1024 */
#define ANHYST_MAX_SLOPE 32767

/* Position of a number in a table with equal segments. */
typedef struct {
  const int16_t *segment; /* lower end of the segment */
  int32_t fraction;       /* position within the segment, 0..32768 */
} anhyst_table_position;

/* Returns the value at a position: entries q15, result q30, exact except for the last bit. */
static inline int32_t anhyst_table_value(anhyst_table_position position)
{
  const int32_t low = position.segment[0];
  const int32_t rise = position.segment[1] - low;
  return low * 32768 + rise * position.fraction;
}

/* Returns numerator*65536/denominator with 14 bits. Requires positive arguments. Saturates. */
static inline int32_t anhyst_quotient(int32_t numerator, int32_t denominator)
{
  const uint16_t up = anhyst_headroom(numerator);
  const uint16_t down = anhyst_headroom(denominator);
  const int32_t top = (int32_t)((uint32_t)numerator << up);
  const int32_t bottom = (int32_t)((uint32_t)denominator << down) >> 16; /* 2^14..2^15 - 1 */
  const int32_t ratio = top / bottom;                                    /* 2^15..2^17 */
  return down >= up ? anhyst_shl_q31(ratio, (uint16_t)(down - up)) : ratio >> (up - down);
}

/* Returns a*fraction, rounded down, with an error of up to 4 LSB. Requires a q31 fraction >= 0. */
static inline int32_t anhyst_times_fraction(int32_t a, int32_t fraction)
{
  const int16_t high = (int16_t)(fraction >> 16);
  const int16_t low = (int16_t)((fraction & 0xFFFF) >> 1);
  return 2 * anhyst_scale(a, high) + (anhyst_scale(a, low) >> 14);
}

/* Returns numerator/denominator, q31, rounded down. Requires 0 <= numerator < denominator. */
static inline int32_t anhyst_ratio(int32_t numerator, int32_t denominator)
{
  const uint32_t divisor = (uint32_t)denominator;
  uint32_t remainder = (uint32_t)numerator;
  uint32_t quotient = 0;
  for (uint16_t digit = 0; digit < 31U; digit++) {
    remainder <<= 1;
    quotient <<= 1;
    if (remainder >= divisor) {
      remainder -= divisor;
      quotient |= 1U;
    }
  }
  return (int32_t)quotient;
}

#endif
