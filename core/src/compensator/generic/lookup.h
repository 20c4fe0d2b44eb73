/* SPDX-License-Identifier: Apache-2.0 */

/* Position of a signal in a table with equal segments. */
typedef struct {
  uint16_t index;       /* index of the segment */
  ANHYST_REAL fraction; /* position within the segment, 0..1 */
} anhyst_table_position_x;

/* Returns the position of a signal that is given in units of the segment width. Outside the table,
   returns the nearest end, and for NaN the lower end. */
static inline anhyst_table_position_x anhyst_locate_x(uint16_t segments, ANHYST_REAL signal)
{
  anhyst_table_position_x position = {0, R(0.0)};
  if (signal >= (ANHYST_REAL)segments) {
    position.index = (uint16_t)(segments - 1U);
    position.fraction = R(1.0);
  } else if (signal > R(0.0)) {
    position.index = (uint16_t)signal;
    position.fraction = signal - (ANHYST_REAL)position.index;
  }
  return position;
}

static inline ANHYST_REAL anhyst_table_value_x(const ANHYST_REAL *table,
                                               anhyst_table_position_x position)
{
  const ANHYST_REAL low = table[position.index];
  return low + position.fraction * (table[position.index + 1U] - low);
}

static inline ANHYST_REAL anhyst_segment_rise_x(const ANHYST_REAL *table,
                                                anhyst_table_position_x position)
{
  return table[position.index + 1U] - table[position.index];
}

static inline ANHYST_REAL anhyst_absolute_x(ANHYST_REAL a) { return a < R(0.0) ? -a : a; }

/* Limits a to low..high. Returns `low` for NaN. */
static inline ANHYST_REAL anhyst_clamped_x(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  if (!(a > low)) {
    return low;
  }
  return a > high ? high : a;
}

/* Returns the rounding error of a difference of two terms of a given size. A smaller residual
   counts as zero. Otherwise, rounding errors would move the state at a constant demand. */
static inline ANHYST_REAL anhyst_rounding_x(ANHYST_REAL size) { return R(4.0) * ANHYST_EPS * size; }

/* Returns whether a table never falls, starts at or above `least`, and ends at or below `most`. */
static inline int anhyst_is_table_rising_x(const ANHYST_REAL *table, uint16_t segments,
                                           ANHYST_REAL least, ANHYST_REAL most)
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
