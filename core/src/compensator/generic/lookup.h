/* SPDX-License-Identifier: Apache-2.0 */

/* Position of a number in a table of equal segments. */
typedef struct {
  uint16_t index;   /* index of the segment */
  ANHYST_REAL part; /* position on the segment, 0..1 */
} anhyst_spot_x;

/* Returns the position of a place counted in segments. Outside the table, returns the nearest end;
   for NaN, the lower end. */
static inline anhyst_spot_x anhyst_spot_of_x(uint16_t segments, ANHYST_REAL place)
{
  anhyst_spot_x spot = {0, R(0.0)};
  if (place >= (ANHYST_REAL)segments) {
    spot.index = (uint16_t)(segments - 1U);
    spot.part = R(1.0);
  } else if (place > R(0.0)) {
    spot.index = (uint16_t)place;
    spot.part = place - (ANHYST_REAL)spot.index;
  }
  return spot;
}

static inline ANHYST_REAL anhyst_value_at_x(const ANHYST_REAL *table, anhyst_spot_x spot)
{
  const ANHYST_REAL low = table[spot.index];
  return low + spot.part * (table[spot.index + 1U] - low);
}

static inline ANHYST_REAL anhyst_rise_at_x(const ANHYST_REAL *table, anhyst_spot_x spot)
{
  return table[spot.index + 1U] - table[spot.index];
}

static inline ANHYST_REAL anhyst_size_x(ANHYST_REAL a) { return a < R(0.0) ? -a : a; }

/* Limits a to low..high; returns low for NaN. */
static inline ANHYST_REAL anhyst_limited_x(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* Returns the rounding error of a difference of terms of this size. A residual below it counts as
   zero. Otherwise, at a constant demand the state would drift in steps of rounding. */
static inline ANHYST_REAL anhyst_noise_x(ANHYST_REAL size) { return R(4.0) * ANHYST_EPS * size; }

/* Returns whether a table with `segments` segments never falls, starts at `least` or above, and
   ends at `most` or below. */
static inline int anhyst_rises_x(const ANHYST_REAL *table, uint16_t segments, ANHYST_REAL least,
                                 ANHYST_REAL most)
{
  if (!(table[0] >= least && table[segments] <= most)) {
    return 0;
  }
  for (uint16_t i = 0; i < segments; i++) {
    if (!(table[i] <= table[i + 1U])) {
      return 0;
    }
  }
  return 1;
}
