/* SPDX-License-Identifier: Apache-2.0 */
#include "cell_table.h"

#include "anhyst/numeric/elementary.h"

#include "cell_shape.h"

/* Pieces of the narrowest curve's width in the first octave, and the most that one is cut into. */
static const double fineness = 4.0;
static const int most_pieces = 1024;
/* What the tables may miss by, of the saturation. */
static const double limit = 1e-6;
/* How far the tables go, in parts of the widest curve and the largest threshold. */
static const double far = 131072.0;
/* Interpolation by a quintic with value, slope and curvature at both ends: h^6*f''''''/46080. */
static const double quintic = 46080.0;

/* Upper bound of the sixth derivative of the curve from |z| on. */
static double sixth(anhyst_shape shape, double z)
{
  const double near = shape == ANHYST_SHAPE_TANH ? 53.0 : 0.45;
  const double z2 = z * z;
  const double tail = shape == ANHYST_SHAPE_TANH ? 134.0 * anhyst_exp_f64(-2.0 * z)
                                                 : 720.0 / (z2 * z2 * z2 * z + 1.0);
  return tail < near ? tail : near;
}

static double centre_of(const anhyst_cell_weights_f64 *w, int j)
{
  return w->centre == NULL ? 0.0 : w->centre[j];
}

static int weights_valid(const anhyst_cell_weights_f64 *w)
{
  int ok = w->cells >= 1 && w->cells <= ANHYST_CELLS_MAX && w->widths >= 1 &&
           !(w->threshold[0] < 0.0) && !(w->threshold[0] > 0.0);
  double sum = 0.0;
  for (int i = 1; ok && i < w->cells; i++) {
    ok = w->threshold[i] > w->threshold[i - 1] && w->threshold[i] < 1e15;
  }
  for (int j = 0; ok && j < w->widths; j++) {
    const double centre = centre_of(w, j);
    ok = w->width[j] > 1e-15 && w->width[j] < 1e15 && centre >= 0.0 && centre < 1e15;
  }
  for (int i = 0; ok && i < w->cells * w->widths; i++) {
    ok = w->weight[i] >= 0.0;
    sum += w->weight[i];
  }
  return ok && sum > 1e-15 && sum < 1e15;
}

/* Narrowest and widest curve that has any weight; a curve is as wide as its centre lies far. */
static void find_widths(const anhyst_cell_weights_f64 *w, double *narrowest, double *widest)
{
  *narrowest = 1e300;
  *widest = 0.0;
  for (int i = 0; i < w->cells * w->widths; i++) {
    const double width = w->width[i % w->widths];
    if (w->weight[i] > 0.0) {
      *narrowest = width < *narrowest ? width : *narrowest;
      const double reach = width + centre_of(w, i % w->widths);
      *widest = reach > *widest ? reach : *widest;
    }
  }
}

/* How far a place is from the interval. */
static double distance(double place, double low, double high)
{
  return place < low ? low - place : (place > high ? place - high : 0.0);
}

/* Error of one piece from low to high on either side, the curves of all cells together. */
static double piece_error(const anhyst_cell_weights_f64 *w, double low, double high)
{
  double sum = 0.0;
  for (int i = 0; i < w->cells; i++) {
    for (int j = 0; j < w->widths; j++) {
      if (w->weight[i * w->widths + j] > 0.0) {
        /* Either half of a curve bends where |x| is the sum of threshold and centre, or their
           difference. */
        const double above = distance(w->threshold[i] + centre_of(w, j), low, high);
        const double below = distance(fabs(w->threshold[i] - centre_of(w, j)), low, high);
        const double away = above < below ? above : below;
        const double part = (high - low) / w->width[j];
        const double cube = part * part * part;
        sum += w->weight[i * w->widths + j] * cube * cube * sixth(w->shape, away / w->width[j]);
      }
    }
  }
  return sum / quintic;
}

/* Cuts the next octave, from begin to twice that, into as many pieces as it needs; 0 where there is
   no room, or the limit cannot be kept. */
static int lay_octave(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights, double aim,
                      double begin)
{
  const double low = (begin - 1.0) / cells->per_unit;
  const double high = (2.0 * begin - 1.0) / cells->per_unit;
  const int octave = cells->octaves;
  double error = piece_error(weights, low, high) / cells->saturation;
  int count = 1;
  int halvings = 0;
  while (error > aim && count < most_pieces) {
    count *= 2;
    halvings++;
    error /= 64.0;
  }
  if (octave == ANHYST_CELLS_OCTAVES || !(error <= limit)) {
    return 0;
  }
  cells->shift[octave] = 52 - halvings;
  cells->per_piece[octave] = (double)count / begin;
  cells->first[octave] = (int64_t)(cell_bits(begin) >> cells->shift[octave]) - cells->pieces;
  cells->pieces += count;
  cells->octaves++;
  return 1;
}

anhyst_status anhyst_cells_lay_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                                   double aim, size_t *pieces)
{
  if (!weights_valid(weights)) {
    return ANHYST_BAD_PARAMETER;
  }
  double narrowest;
  double widest;
  find_widths(weights, &narrowest, &widest);
  cells->cells = weights->cells;
  cells->saturation = 0.0;
  for (int i = 0; i < weights->cells * weights->widths; i++) {
    cells->saturation += weights->weight[i];
  }
  for (int i = 0; i < weights->cells; i++) {
    cells->threshold[i] = weights->threshold[i];
  }
  cells->scale = widest + weights->threshold[weights->cells - 1];
  cells->reach = far * cells->scale;
  cells->per_unit = fineness / narrowest;
  /* The fourth power of such a part is 6e-18. */
  cells->tangent = 5e-5 * narrowest;
  cells->pieces = 0;
  cells->octaves = 0;
  double begin = 1.0;
  while (begin < 1.0 + cells->reach * cells->per_unit) {
    if (!lay_octave(cells, weights, aim, begin)) {
      return ANHYST_BAD_PARAMETER;
    }
    begin *= 2.0;
  }
  cells->top = begin * (1.0 - 1e-15);
  *pieces = (size_t)cells->pieces * 2U * (size_t)cells->cells;
  return ANHYST_OK;
}

/* Jets of all rows at one place. */
static void rows_at(const anhyst_cell_weights_f64 *w, double x, cell_jet *rows)
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

/* The piece over h away from zero; turn is -1 where that is towards falling x. */
static void fill(double *c, const cell_jet *from, const cell_jet *to, double h, double turn)
{
  c[0] = from->f;
  c[1] = turn * h * from->f1;
  c[2] = 0.5 * h * h * from->f2;
  const double value = to->f - c[0] - c[1] - c[2];
  const double slope = turn * h * to->f1 - c[1] - 2.0 * c[2];
  const double curve = h * h * to->f2 - 2.0 * c[2];
  c[3] = 10.0 * value - 4.0 * slope + 0.5 * curve;
  c[4] = -15.0 * value + 7.0 * slope - curve;
  c[5] = 6.0 * value - 3.0 * slope + 0.5 * curve;
}

/* One side of zero, all rows; *steep becomes the largest slope at a node, *free that of cell 0. */
static void fill_side(const anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                      anhyst_cell_piece_f64 *storage, double turn, double *steep, double *free)
{
  cell_jet ends[2][ANHYST_CELLS_MAX];
  int64_t piece = turn < 0.0 ? cells->pieces : 0;
  double from = 0.0;
  rows_at(weights, from, ends[0]);
  double begin = 1.0;
  for (int octave = 0; octave < cells->octaves; octave++) {
    const int count = 1 << (52 - cells->shift[octave]);
    for (int i = 1; i <= count; i++) {
      const double to = (begin * (1.0 + (double)i / (double)count) - 1.0) / cells->per_unit;
      rows_at(weights, turn * to, ends[1]);
      for (int row = 0; row < weights->cells; row++) {
        fill(storage[piece + 2 * (int64_t)row * cells->pieces].c, &ends[0][row], &ends[1][row],
             to - from, turn);
        *steep = ends[0][row].f1 > *steep ? ends[0][row].f1 : *steep;
      }
      *free = ends[0][0].f1 > *free ? ends[0][0].f1 : *free;
      memcpy(ends[0], ends[1], sizeof ends[0]);
      from = to;
      piece++;
    }
    begin *= 2.0;
  }
}

void anhyst_cells_tabulate_f64(anhyst_cells_f64 *cells, const anhyst_cell_weights_f64 *weights,
                               anhyst_cell_piece_f64 *storage)
{
  cells->reversible = 0.0;
  cells->steepest = 0.0;
  fill_side(cells, weights, storage, 1.0, &cells->steepest, &cells->reversible);
  fill_side(cells, weights, storage, -1.0, &cells->steepest, &cells->reversible);
  /* Between nodes a curve can be a little steeper than at both. */
  cells->steepest *= 1.001;
  cells->rows = storage;
}
