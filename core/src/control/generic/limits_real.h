/* SPDX-License-Identifier: Apache-2.0 */

static int is_number(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

/* Limits a to low..high. Returns `low` for NaN. */
static ANHYST_REAL clamp(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

static ANHYST_REAL round_to_grid(ANHYST_REAL current, ANHYST_REAL low, ANHYST_REAL high,
                                 ANHYST_REAL step)
{
  const int32_t steps = (int32_t)((current - low) / step + R(0.5));
  return clamp(low + (ANHYST_REAL)steps * step, low, high);
}
