/* SPDX-License-Identifier: Apache-2.0 */

/* Where a number falls in a table of equal segments. */
typedef struct {
  uint16_t index;   /* of the lower end of its segment */
  ANHYST_REAL part; /* of the segment, 0..1 */
} anhyst_spot_x;

/* The spot of a place counted in segments; beyond the table the nearest end, and the lower one for
   what is not a number. */
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

/* The value there. */
static inline ANHYST_REAL anhyst_value_at_x(const ANHYST_REAL *table, anhyst_spot_x spot)
{
  const ANHYST_REAL low = table[spot.index];
  return low + spot.part * (table[spot.index + 1U] - low);
}

/* The rise over its segment. */
static inline ANHYST_REAL anhyst_rise_at_x(const ANHYST_REAL *table, anhyst_spot_x spot)
{
  return table[spot.index + 1U] - table[spot.index];
}

/* |a|. */
static inline ANHYST_REAL anhyst_size_x(ANHYST_REAL a) { return a < R(0.0) ? -a : a; }

/* The number of low..high nearest to a; low for what is not a number. */
static inline ANHYST_REAL anhyst_limited_x(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* What rounding leaves of a difference of terms of this size: below it a residual is zero. Without
   that a standing demand would creep, up in steps of rounding and down again by another way. */
static inline ANHYST_REAL anhyst_noise_x(ANHYST_REAL size) { return R(4.0) * ANHYST_EPS * size; }

/* Whether a table of so many segments begins at least at one number, never falls, and ends at most
   at another. */
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
