/* SPDX-License-Identifier: Apache-2.0 */

/* Limits a to low..high. Returns `low` for NaN. */
static inline ANHYST_REAL anhyst_clamped_x(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}
