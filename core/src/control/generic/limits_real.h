/* SPDX-License-Identifier: Apache-2.0 */

static int is_number(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

/* The lower limit for what is not a number. */
static ANHYST_REAL within(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* The nearest of the converter's currents, for one within the limits. */
static ANHYST_REAL on_grid(ANHYST_REAL current, ANHYST_REAL low, ANHYST_REAL high, ANHYST_REAL step)
{
  const int32_t steps = (int32_t)((current - low) / step + R(0.5));
  return within(low + (ANHYST_REAL)steps * step, low, high);
}
