/* SPDX-License-Identifier: Apache-2.0 */
/* Operations of both floating-point formats. The type `number` is float or double. */

static inline number absolute(number a) { return a < (number)0 ? -a : a; }

/* Limits a to low..high. Returns `low` for NaN. */
static inline number clamp(number a, number low, number high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}
