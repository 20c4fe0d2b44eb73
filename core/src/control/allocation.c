/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/allocation.h"

#include "anhyst/numeric/fixed.h"
#include "anhyst/numeric/q31.h"

static int is_force_valid(int32_t a) { return a > 0; }
static int32_t half(int32_t a) { return a >> 1; }

/* Returns a*b, rounded down, with an error below 4 LSB. Requires a >= 0 and b >= 0. */
static int32_t product(int32_t a, int32_t b)
{
  const int16_t high = (int16_t)(b >> 16);
  const int16_t low = (int16_t)((b & 0xFFFF) >> 1);
  return anhyst_add_q31(2 * anhyst_scale(a, high), anhyst_scale(a, low) >> 14);
}

/* Returns smaller/larger as a q31 by long division with two digits, less than 16 LSB below the
   exact ratio. Requires 0 <= smaller <= larger and larger > 0. The clamps only have an effect, to
   prevent overflow, if the arguments violate this requirement. */
static int32_t ratio(int32_t smaller, int32_t larger)
{
  const uint16_t up = anhyst_headroom(larger);
  const int32_t top = (int32_t)((uint32_t)smaller << up);
  const int32_t bottom = (int32_t)((uint32_t)larger << up); /* 2^30..2^31 - 1 */
  const int32_t divisor = (bottom >> 15) + 1;               /* rounded up */
  const int32_t digit = anhyst_clamp(top / divisor, 0, ANHYST_Q15_MAX);
  const int32_t product_of_digit = 2 * anhyst_scale(bottom, (int16_t)digit);
  const int32_t remainder = anhyst_clamp(anhyst_sub_q31(top, product_of_digit), 0, 131071);
  const int32_t second_digit = (remainder * 16384) / divisor; /* 2^-29 */
  return anhyst_add_q31(digit * 65536, second_digit * 4);
}

/* Returns sqrt(1 + t*t)/2, q31. A linear start value is within 1 %; Newton steps refine it. */
static int32_t half_root(int32_t t)
{
  const int32_t square = product(t, t);
  const int32_t quarter = (ANHYST_Q30_ONE >> 1) + (square >> 2); /* a quarter of 1 + t*t */
  int32_t root = 1083180000 + anhyst_scale(square, 13573);       /* 0.5..0.72 */
  root = (root >> 1) + (ratio(quarter, root) >> 1);
  return (root >> 1) + (ratio(quarter, root) >> 1);
}

/* Returns |net|/2 + sqrt(net^2/4 + idle^2). */
static int32_t larger_force(int32_t net, int32_t idle)
{
  const int32_t half = anhyst_abs_q31(net) >> 1;
  const int32_t longer_leg = half > idle ? half : idle;
  const int32_t shorter_leg = half > idle ? idle : half;
  const int32_t hypotenuse =
      anhyst_shl_q31(product(longer_leg, half_root(ratio(shorter_leg, longer_leg))), 1);
  const int32_t larger = anhyst_add_q31(half, hypotenuse);
  return larger > idle ? larger : idle;
}

/* Uses a quotient, because the difference of two large forces would lose digits. */
static int32_t smaller_force(int32_t larger, int32_t idle)
{
  return product(idle, ratio(idle, larger));
}

#include "generic/allocation.h"
