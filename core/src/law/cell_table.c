/* SPDX-License-Identifier: Apache-2.0 */
#include "cell_table.h"

#include "anhyst/numeric/elementary.h"

#include "cell_shape.h"

/* Segments per width of the narrowest curve in the first octave; maximum segments per octave. */
static const double SEGMENTS_PER_WIDTH = 4.0;
static const int MAX_OCTAVE_SEGMENTS = 1024;
/* Maximum error of the tables, as a fraction of the saturation. */
static const double MAX_TABLE_ERROR = 1e-6;
/* Range of the tables, in units of the width of the widest curve plus the largest threshold. */
static const double RANGE_FACTOR = 131072.0;
/* Divisor of h^6*f'''''', the error of a quintic with value, slope and curvature at both ends. */
static const double QUINTIC_ERROR_DIVISOR = 46080.0;

/* Returns an upper bound of the sixth derivative of the curve at arguments of |z| and above. */
static double sixth_derivative_bound(anhyst_shape shape, double z)
{
  const double bound_at_zero = shape == ANHYST_SHAPE_TANH ? 53.0 : 0.45;
  const double z2 = z * z;
  const double tail_bound = shape == ANHYST_SHAPE_TANH ? 134.0 * anhyst_exp_f64(-2.0 * z)
                                                       : 720.0 / (z2 * z2 * z2 * z + 1.0);
  return tail_bound < bound_at_zero ? tail_bound : bound_at_zero;
}

static double curve_centre(const anhyst_cell_weights_f64 *w, int j)
{
  return w->centre == NULL ? 0.0 : w->centre[j];
}

static int are_weights_valid(const anhyst_cell_weights_f64 *w)
{
  int is_valid = w->cells >= 1 && w->cells <= ANHYST_CELLS_MAX && w->widths >= 1 &&
                 !(w->threshold[0] < 0.0) && !(w->threshold[0] > 0.0);
  double sum = 0.0;
  for (int i = 1; is_valid && i < w->cells; i++) {
    is_valid = w->threshold[i] > w->threshold[i - 1] && w->threshold[i] < 1e15;
  }
  for (int j = 0; is_valid && j < w->widths; j++) {
    const double centre = curve_centre(w, j);
    is_valid = w->width[j] > 1e-15 && w->width[j] < 1e15 && centre >= 0.0 && centre < 1e15;
  }
  for (int i = 0; is_valid && i < w->cells * w->widths; i++) {
    is_valid = w->weight[i] >= 0.0;
    sum += w->weight[i];
  }
  return is_valid && sum > 1e-15 && sum < 1e15;
}

/* Finds the narrowest and the widest curve with a weight above 0. The width of a curve includes the
   distance of its centre from zero. */
static void find_extreme_widths(const anhyst_cell_weights_f64 *w, double *narrowest, double *widest)
{
  *narrowest = 1e300;
  *widest = 0.0;
  for (int i = 0; i < w->cells * w->widths; i++) {
    const double width = w->width[i % w->widths];
    if (w->weight[i] > 0.0) {
      *narrowest = width < *narrowest ? width : *narrowest;
      const double shifted_width = width + curve_centre(w, i % w->widths);
      *widest = shifted_width > *widest ? shifted_width : *widest;
    }
  }
}

static double distance_to_interval(double position, double low, double high)
{
  return position < low ? low - position : (position > high ? position - high : 0.0);
}

/* Returns an error bound for a segment, low to high on either side, for the sum of all cells. */
static double segment_error_bound(const anhyst_cell_weights_f64 *w, double low, double high)
{
  double sum = 0.0;
  for (int i = 0; i < w->cells; i++) {
    for (int j = 0; j < w->widths; j++) {
      if (w->weight[i * w->widths + j] > 0.0) {
        /* The halves of a curve bend where |x| is the sum or difference of threshold and centre. */
        const double above = distance_to_interval(w->threshold[i] + curve_centre(w, j), low, high);
        const double below =
            distance_to_interval(fabs(w->threshold[i] - curve_centre(w, j)), low, high);
        const double distance_from_bend = above < below ? above : below;
        const double relative_length = (high - low) / w->width[j];
        const double cube = relative_length * relative_length * relative_length;
        sum += w->weight[i * w->widths + j] * cube * cube *
               sixth_derivative_bound(w->shape, distance_from_bend / w->width[j]);
      }
    }
  }
  return sum / QUINTIC_ERROR_DIVISOR;
}

/* Divides the next octave, from begin to 2*begin, into the required number of segments. Returns 0
   if the table is full, or if the error exceeds MAX_TABLE_ERROR. */
static int divide_octave(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                         double aim, double begin)
{
  const double low = (begin - 1.0) / cells->inverse_unit;
  const double high = (2.0 * begin - 1.0) / cells->inverse_unit;
  const int octave = cells->octaves;
  double error = segment_error_bound(weights, low, high) / cells->saturation;
  int count = 1;
  int bisections = 0;
  while (error > aim && count < MAX_OCTAVE_SEGMENTS) {
    count *= 2;
    bisections++;
    error /= 64.0;
  }
  if (octave == ANHYST_CELLS_OCTAVES || !(error <= MAX_TABLE_ERROR)) {
    return 0;
  }
  cells->shift[octave] = 52 - bisections;
  cells->intervals_per_unit[octave] = (double)count / begin;
  cells->first[octave] = (int64_t)(cell_bits_of(begin) >> cells->shift[octave]) - cells->pieces;
  cells->pieces += count;
  cells->octaves++;
  return 1;
}

anhyst_status anhyst_cells_lay_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                                   double aim, size_t *pieces)
{
  if (!are_weights_valid(weights)) {
    return ANHYST_BAD_PARAMETER;
  }
  double narrowest;
  double widest;
  find_extreme_widths(weights, &narrowest, &widest);
  cells->cells = weights->cells;
  cells->saturation = 0.0;
  for (int i = 0; i < weights->cells * weights->widths; i++) {
    cells->saturation += weights->weight[i];
  }
  for (int i = 0; i < weights->cells; i++) {
    cells->threshold[i] = weights->threshold[i];
  }
  cells->scale = widest + weights->threshold[weights->cells - 1];
  cells->x_max = RANGE_FACTOR * cells->scale;
  cells->inverse_unit = SEGMENTS_PER_WIDTH / narrowest;
  /* 5e-5 of the narrowest width. The fourth power of 5e-5 is 6e-18. */
  cells->max_cubic_step = 5e-5 * narrowest;
  cells->pieces = 0;
  cells->octaves = 0;
  double begin = 1.0;
  while (begin < 1.0 + cells->x_max * cells->inverse_unit) {
    if (!divide_octave(cells, weights, aim, begin)) {
      return ANHYST_BAD_PARAMETER;
    }
    begin *= 2.0;
  }
  cells->table_end = begin * (1.0 - 1e-15);
  *pieces = (size_t)cells->pieces * 2U * (size_t)cells->cells;
  return ANHYST_OK;
}

static void evaluate_rows(const anhyst_cell_weights_f64 *w, double x, cell_jet *rows)
{
  cell_jet sum = {0.0, 0.0, 0.0};
  for (int i = 0; i < w->cells; i++) {
    for (int j = 0; j < w->widths; j++) {
      const double weight = w->weight[i * w->widths + j];
      if (weight > 0.0) {
        const double inverse = 1.0 / w->width[j];
        double z;
        const cell_jet at = anhyst_cell_curve(w, j, x - w->threshold[i], &z);
        sum.f += weight * at.f;
        sum.f1 += weight * inverse * at.f1;
        sum.f2 += weight * inverse * inverse * at.f2;
      }
    }
    rows[i] = sum;
  }
}

/* Fits the polynomial of a segment of length h, away from zero; `direction` is -1 for x < 0. */
static void fit_segment(double *c, const cell_jet *from, const cell_jet *to, double h,
                        double direction)
{
  c[0] = from->f;
  c[1] = direction * h * from->f1;
  c[2] = 0.5 * h * h * from->f2;
  const double value = to->f - c[0] - c[1] - c[2];
  const double slope = direction * h * to->f1 - c[1] - 2.0 * c[2];
  const double curve = h * h * to->f2 - 2.0 * c[2];
  c[3] = 10.0 * value - 4.0 * slope + 0.5 * curve;
  c[4] = -15.0 * value + 7.0 * slope - curve;
  c[5] = 6.0 * value - 3.0 * slope + 0.5 * curve;
}

/* Tabulates all rows on one side of zero field. Raises *steepest to the largest slope at a knot,
   and *steepest_reversible to the largest slope of cell 0. */
static void tabulate_side(const anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                          anhyst_cell_piece_f64 *storage, double direction, double *steepest,
                          double *steepest_reversible)
{
  cell_jet ends[2][ANHYST_CELLS_MAX];
  int64_t segment = direction < 0.0 ? cells->pieces : 0;
  double from = 0.0;
  evaluate_rows(weights, from, ends[0]);
  double begin = 1.0;
  for (int octave = 0; octave < cells->octaves; octave++) {
    const int count = 1 << (52 - cells->shift[octave]);
    for (int i = 1; i <= count; i++) {
      const double to = (begin * (1.0 + (double)i / (double)count) - 1.0) / cells->inverse_unit;
      evaluate_rows(weights, direction * to, ends[1]);
      for (int row = 0; row < weights->cells; row++) {
        fit_segment(storage[segment + 2 * (int64_t)row * cells->pieces].c, &ends[0][row],
                    &ends[1][row], to - from, direction);
        *steepest = ends[0][row].f1 > *steepest ? ends[0][row].f1 : *steepest;
        if (row == 0 && ends[0][row].f1 > *steepest_reversible) {
          *steepest_reversible = ends[0][row].f1;
        }
      }
      memcpy(ends[0], ends[1], sizeof ends[0]);
      from = to;
      segment++;
    }
    begin *= 2.0;
  }
}

void anhyst_cells_tabulate_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                               anhyst_cell_piece_f64 *storage)
{
  cells->reversal_slope = 0.0;
  cells->max_slope = 0.0;
  tabulate_side(cells, weights, storage, 1.0, &cells->max_slope, &cells->reversal_slope);
  tabulate_side(cells, weights, storage, -1.0, &cells->max_slope, &cells->reversal_slope);
  /* Between two knots, a curve can be slightly steeper than at both knots. */
  cells->max_slope *= 1.001;
  cells->rows = storage;
}
