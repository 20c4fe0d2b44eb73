/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/allocation.h"

#include "anhyst/numeric/fixed.h"
#include "anhyst/numeric/q31.h"

static int is_force(int32_t a) { return a > 0; }

static int32_t half(int32_t a) { return a >> 1; }

/* a*b, neither below 0; floor, error below 4 units in the last place. */
static int32_t product(int32_t a, int32_t b)
{
  const int16_t high = (int16_t)(b >> 16);
  const int16_t low = (int16_t)((b & 0xFFFF) >> 1);
  return anhyst_add_q31(2 * anhyst_scale(a, high), anhyst_scale(a, low) >> 14);
}

/* smaller/larger as a q31, 0 <= smaller <= larger, larger > 0; below the exact one by less than 16
   units in the last place. Two digits by long division. For such numbers no clamp acts: with them
   nothing overflows for any others. */
static int32_t ratio(int32_t smaller, int32_t larger)
{
  const uint16_t up = anhyst_headroom(larger);
  const int32_t top = (int32_t)((uint32_t)smaller << up);
  const int32_t bottom = (int32_t)((uint32_t)larger << up); /* 2^30..2^31 - 1 */
  const int32_t above = (bottom >> 15) + 1;                 /* so that no digit is too large */
  const int32_t digit = anhyst_clamp(top / above, 0, ANHYST_Q15_MAX);
  const int32_t reached = 2 * anhyst_scale(bottom, (int16_t)digit);
  const int32_t rest = anhyst_clamp(anhyst_sub_q31(top, reached), 0, 131071);
  const int32_t fine = (rest * 16384) / above; /* 2^-29 */
  return anhyst_add_q31(digit * 65536, fine * 4);
}

/* Half of the root of 1 + t*t, q31. A line within 1 % to begin with; each step doubles the
   digits. */
static int32_t half_root(int32_t t)
{
  const int32_t square = product(t, t);
  const int32_t quarter = (ANHYST_Q30_ONE >> 1) + (square >> 2); /* of 1 + t*t */
  int32_t root = 1083180000 + anhyst_scale(square, 13573);       /* 0.5..0.72 */
  root = (root >> 1) + (ratio(quarter, root) >> 1);
  return (root >> 1) + (ratio(quarter, root) >> 1);
}

/* |net|/2 + sqrt(net^2/4 + idle^2). */
static int32_t larger_of(int32_t net, int32_t idle)
{
  const int32_t half = anhyst_abs_q31(net) >> 1;
  const int32_t most = half > idle ? half : idle;
  const int32_t least = half > idle ? idle : half;
  const int32_t across = anhyst_shl_q31(product(most, half_root(ratio(least, most))), 1);
  const int32_t larger = anhyst_add_q31(half, across);
  return larger > idle ? larger : idle;
}

/* As a quotient: a difference of two large forces would lose its digits. */
static int32_t smaller_of(int32_t larger, int32_t idle)
{
  return product(idle, ratio(idle, larger));
}

#include "generic/allocation.h"
