/* SPDX-License-Identifier: Apache-2.0 */
/* Operations that the floating-point formats share; number is float or double. */

/* |a| */
static inline number size_of(number a) { return a < (number)0 ? -a : a; }

/* The number of low..high nearest to a; low for what is not a number. */
static inline number within(number a, number low, number high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}
