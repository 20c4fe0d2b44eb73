/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolation in the tables of a parameter block, and the quotient of Newton's steps. */
#ifndef ANHYST_LOOKUP_H
#define ANHYST_LOOKUP_H

#include "anhyst/fixed.h"

/* Slopes are counted in 1/1024. */
#define ANHYST_SLOPE_MAX 32767

/* Where a number falls in a table of equal segments. */
typedef struct {
  const int16_t *at; /* lower end of the segment */
  int32_t part;      /* of the segment, 0..32768 */
} anhyst_spot;

/* The value there: q15 in, q30 out, exact between the entries but for its last place. */
static inline int32_t anhyst_value_at(anhyst_spot spot)
{
  const int32_t low = spot.at[0];
  const int32_t rise = spot.at[1] - low;
  return low * 32768 + rise * spot.part;
}

/* numerator*65536/denominator, both positive, to 14 bits; saturates. */
static inline int32_t anhyst_quotient(int32_t numerator, int32_t denominator)
{
  const uint16_t up = anhyst_headroom(numerator);
  const uint16_t down = anhyst_headroom(denominator);
  const int32_t top = (int32_t)((uint32_t)numerator << up);
  const int32_t bottom = (int32_t)((uint32_t)denominator << down) >> 16; /* 2^14..2^15 - 1 */
  const int32_t ratio = top / bottom;                                    /* 2^15..2^17 */
  return down >= up ? anhyst_shl_q31(ratio, (uint16_t)(down - up)) : ratio >> (up - down);
}

#endif
