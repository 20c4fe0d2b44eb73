/* SPDX-License-Identifier: Apache-2.0 */
/* Positions in the tables of play cells, and interpolation in a table row. */
#ifndef ANHYST_CELL_TABLE_H
#define ANHYST_CELL_TABLE_H

#include <math.h>
#include <string.h>

#include "anhyst/law/cells.h"

typedef struct {
  double value, slope, curve, third;
} cell_sum;

static inline uint64_t cell_bits_of(double value)
{
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

static inline double cell_double_of(uint64_t bits)
{
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* Returns the bits of 1 + |x|/unit, at most the end of the tables. The exponent is the octave. */
static inline uint64_t cell_position_bits(const anhyst_cells_f64 *cells, double x)
{
  const double position = 1.0 + fabs(x) * cells->inverse_unit;
  return cell_bits_of(position < cells->table_end ? position : cells->table_end);
}

static inline size_t cell_octave(uint64_t bits) { return (size_t)(bits >> 52) - 1023U; }

/* Returns T_(row+1)(x), the sum of row + 1 active cells, and the derivatives of this sum. */
static inline cell_sum cell_evaluate_row(const anhyst_cells_f64 *cells, int row, double x)
{
  const uint64_t bits = cell_position_bits(cells, x);
  const size_t octave = cell_octave(bits);
  const int shift = cells->shift[octave];
  const uint64_t number = bits >> shift;
  const double u =
      (cell_double_of(bits) - cell_double_of(number << shift)) * cells->intervals_per_unit[octave];
  const int64_t side = 2 * (int64_t)row + (x < 0.0 ? 1 : 0);
  const int64_t piece = side * cells->pieces + ((int64_t)number - cells->first[octave]);
  const double *c = cells->rows[piece].c;
  const double u2 = u * u;
  const double stretch = cells->inverse_unit * cells->intervals_per_unit[octave];
  cell_sum found;
  found.value = (c[0] + u * c[1]) + u2 * ((c[2] + u * c[3]) + u2 * (c[4] + u * c[5]));
  found.slope =
      ((c[1] + u * (2.0 * c[2])) + u2 * ((3.0 * c[3] + u * (4.0 * c[4])) + u2 * (5.0 * c[5]))) *
      (x < 0.0 ? -stretch : stretch);
  found.curve = ((2.0 * c[2] + u * (6.0 * c[3])) + u2 * (12.0 * c[4] + u * (20.0 * c[5]))) *
                (stretch * stretch);
  found.third = (6.0 * c[3] + u * (24.0 * c[4] + u * (60.0 * c[5]))) *
                ((x < 0.0 ? -stretch : stretch) * (stretch * stretch));
  return found;
}

#endif
