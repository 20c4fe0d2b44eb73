/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/cells.h"

#include <float.h>

#include "cell_table.h"

/* Slope of the equation below which the search follows the path instead of using a bracket. */
static const double MIN_SLOPE = 1e-6;

/* A path in the direction of travel. Positions are multiplied by `sign`: every path rises. */
typedef struct {
  const anhyst_cells_f64 *cells;
  const anhyst_cells_state_f64 *state;
  double sign, omega, target;
  double from;      /* start of the path */
  double low;       /* lower bound of the solution; the left side is below the target */
  double residual;  /* target minus left side at the lower bound, > 0 */
  double resting_m; /* sum of the cells at rest */
  anhyst_cells_bend_f64 derivatives;
  int active;
  int is_reversed; /* whether the path moves against the direction of the state */
} path;

static double left_side(const path *p, double x, const cell_sum *at)
{
  return x + p->omega * (at->value + p->resting_m);
}

/* Returns the position at which the next cell becomes active. */
static double next_activation(const path *p)
{
  const int i = p->active;
  if (i >= p->cells->cells) {
    return HUGE_VAL;
  }
  const double r = p->cells->threshold[i];
  if (p->is_reversed && i < p->state->active) {
    return p->from + 2.0 * r; /* the cell was active until the reversal */
  }
  return p->sign * p->state->play_position[i] + r;
}

static anhyst_cells_bend_f64 row_derivatives(const cell_sum *at)
{
  const anhyst_cells_bend_f64 bend = {at->slope, at->curve, at->third};
  return bend;
}

/* Makes the next cell active from x on. At x, the present row has the value row_value. */
static void activate_cell(path *p, double x, double row_value)
{
  const cell_sum next_row = cell_evaluate_row(p->cells, p->active, x);
  p->resting_m -= next_row.value - row_value;
  p->derivatives = row_derivatives(&next_row);
  p->active++;
  if (p->active == p->cells->cells) {
    p->resting_m = 0.0; /* so that rounding errors do not accumulate from cycle to cycle */
  }
}

/* Returns the solution t of residual = t + omega*(slope*t + curve/2*t^2 + third/6*t^3), to third
   order. If the step is too long for a third-order solution, returns the linear solution. */
static inline double taylor_step(double residual, double omega, const anhyst_cells_bend_f64 *bend)
{
  const double inverse = 1.0 / (1.0 + omega * bend->slope);
  const double linear_step = residual * inverse;
  const double inverse_omega = inverse * omega;
  const double second = (0.5 * inverse_omega * bend->curve) * linear_step;
  const double third = (inverse_omega * bend->third * (1.0 / 6.0)) * (linear_step * linear_step);
  const double correction = third + second * (1.0 - 2.0 * second);
  return fabs(correction) < 0.25 ? linear_step - linear_step * correction : linear_step;
}

static void store_candidate(const path *p, double x, const cell_sum *at, double t,
                            anhyst_cells_candidate_f64 *candidate)
{
  const double third = 0.5 * t * at->third;
  candidate->x = p->sign * (x + t);
  candidate->m = p->sign * (at->value + p->resting_m +
                            t * (at->slope + t * (0.5 * at->curve + third * (1.0 / 3.0))));
  candidate->direction = p->sign;
  candidate->resting_m = p->resting_m;
  candidate->derivatives.slope = at->slope + t * (at->curve + third);
  candidate->derivatives.curve = at->curve + t * at->third;
  candidate->derivatives.third = at->third;
  candidate->active = p->active;
}

static double rounding_error(const path *p, double x)
{
  return 4.0 * DBL_EPSILON * (fabs(x) + fabs(p->target) + fabs(p->omega) * p->cells->saturation);
}

/* Solves in the present row by Newton's method with curvature, starting at x. The solution is
   between p->low and a position at which the left side exceeds the target. */
static anhyst_status solve_on_row(const path *p, double x, double upper_bound,
                                  anhyst_cells_candidate_f64 *candidate)
{
  double low = p->low;
  double high = upper_bound;
  double longest = high - low;
  for (int i = 0; i < 200; i++) {
    const cell_sum at = cell_evaluate_row(p->cells, p->active - 1, x);
    const anhyst_cells_bend_f64 bend = row_derivatives(&at);
    const double residual = p->target - left_side(p, x, &at);
    const double step = taylor_step(residual, p->omega, &bend);
    const double next = x + step;
    if (residual > 0.0) {
      low = x;
    } else {
      high = x;
    }
    const int is_inside = next >= low && next <= high;
    if (is_inside && fabs(step) <= p->cells->max_cubic_step) {
      store_candidate(p, x, &at, step, candidate);
      return ANHYST_OK;
    }
    /* Plays are rounded to the floating-point grid at the start of the path. Near a solution at 0,
       the interval would otherwise stay wide compared with x. */
    const double resolution = 2.0 * DBL_EPSILON * (fabs(x) + (i < 100 ? 0.0 : fabs(p->from)));
    if (fabs(residual) <= rounding_error(p, x) || high - low <= resolution) {
      store_candidate(p, x, &at, 0.0, candidate);
      return ANHYST_OK;
    }
    if (is_inside && fabs(step) <= longest) {
      longest = 0.5 * fabs(step); /* Newton steps could oscillate across a bend */
      x = next;
    } else {
      x = 0.5 * (low + high);
      longest = high - low;
    }
  }
  return ANHYST_NOT_CONVERGED;
}

/* Solves row by row for a rising left side, while the solution is after the start of the next cell.
   Usually the solution is before this start, so that the next row need not be evaluated. */
static anhyst_status solve_monotonic(path *p, double steepest,
                                     anhyst_cells_candidate_f64 *candidate)
{
  for (;;) {
    const double edge = next_activation(p);
    const double guess = p->low + taylor_step(p->residual, p->omega, &p->derivatives);
    /* Rounding errors, also of the first residual, could move the solution beyond the bound. */
    const double min_slope = 1.0 + p->omega * steepest;
    const double farthest = p->low + (p->omega > 0.0 ? p->residual : p->residual / min_slope);
    double upper_bound = farthest + rounding_error(p, farthest) + 4.0 * DBL_EPSILON * fabs(p->low);
    if (guess < edge) {
      const anhyst_status status =
          solve_on_row(p, guess < upper_bound ? guess : upper_bound, upper_bound, candidate);
      if (status != ANHYST_OK || p->sign * candidate->x <= edge) {
        return status;
      }
    }
    const cell_sum at = cell_evaluate_row(p->cells, p->active - 1, edge);
    const double residual = p->target - left_side(p, edge, &at);
    if (residual <= 0.0) {
      upper_bound = edge < upper_bound ? edge : upper_bound;
      return solve_on_row(p, 0.5 * (p->low + upper_bound), upper_bound, candidate);
    }
    activate_cell(p, edge, at.value);
    p->low = edge > p->low ? edge : p->low;
    p->residual = residual;
  }
}

static double next_knot(const anhyst_cells_f64 *cells, double x)
{
  const uint64_t bits = cell_position_bits(cells, x);
  const int shift = cells->shift[cell_octave(bits)];
  uint64_t segment = bits >> shift;
  double node = x;
  if (x >= 0.0) {
    while (!(node > x)) {
      segment++;
      node = (cell_double_of(segment << shift) - 1.0) / cells->inverse_unit;
    }
    return node;
  }
  const double next_inward = -(cell_double_of(segment << shift) - 1.0) / cells->inverse_unit;
  if (next_inward > x) {
    return next_inward;
  }
  const uint64_t previous_bits = (segment << shift) - 1U;
  if (previous_bits < cell_bits_of(1.0)) {
    return 0.0;
  }
  const int inner_shift = cells->shift[cell_octave(previous_bits)];
  return -(cell_double_of((previous_bits >> inner_shift) << inner_shift) - 1.0) /
         cells->inverse_unit;
}

/* Returns the position at which the left side is largest, or at which it reaches the target. */
static double find_fold(const path *p, double low, double high)
{
  for (int i = 0; i < 60; i++) {
    const double middle = 0.5 * (low + high);
    const cell_sum at = cell_evaluate_row(p->cells, p->active - 1, middle);
    if (left_side(p, middle, &at) >= p->target) {
      return middle;
    }
    if (1.0 + p->omega * at.slope > 0.0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

/* Follows the path segment by segment to the first solution, at which m may jump. */
static anhyst_status solve_with_jumps(path *p, anhyst_cells_candidate_f64 *candidate)
{
  while (p->low < p->cells->x_max) {
    const double edge = next_activation(p);
    const double node = next_knot(p->cells, p->low);
    const double end = edge < node ? edge : node;
    const cell_sum at = cell_evaluate_row(p->cells, p->active - 1, end);
    const double residual = p->target - left_side(p, end, &at);
    if (residual <= 0.0) {
      return solve_on_row(p, 0.5 * (p->low + end), end, candidate);
    }
    if (1.0 + p->omega * p->derivatives.slope > 0.0 && 1.0 + p->omega * at.slope < 0.0) {
      const double maximum = find_fold(p, p->low, end);
      const cell_sum row_at_maximum = cell_evaluate_row(p->cells, p->active - 1, maximum);
      if (left_side(p, maximum, &row_at_maximum) >= p->target) {
        return solve_on_row(p, 0.5 * (p->low + maximum), maximum, candidate);
      }
    }
    p->low = end > p->low ? end : p->low;
    p->residual = residual;
    p->derivatives = row_derivatives(&at);
    if (edge <= node) {
      activate_cell(p, edge, at.value);
    }
  }
  return ANHYST_OUT_OF_RANGE;
}

anhyst_status anhyst_cells_solve_f64(const anhyst_cells_f64 *cells,
                                     const anhyst_cells_state_f64 *state, double omega, double r,
                                     anhyst_cells_candidate_f64 *candidate)
{
  const double residual = r - state->x - omega * state->m;
  if (!(fabs(residual) < 4.0 * (cells->x_max + fabs(omega) * cells->saturation))) {
    return ANHYST_OUT_OF_RANGE;
  }
  if (!(1.0 + omega * cells->reversal_slope > MIN_SLOPE)) {
    return ANHYST_REFUSED;
  }
  path p;
  p.sign = residual < 0.0 ? -1.0 : 1.0;
  p.is_reversed = p.sign * state->direction <= 0.0;
  p.cells = cells;
  p.state = state;
  p.omega = omega;
  p.target = p.sign * r;
  if (fabs(residual) <= rounding_error(&p, state->x)) {
    candidate->x = state->x;
    candidate->m = state->m;
    candidate->direction = state->direction;
    candidate->resting_m = state->resting_m;
    candidate->derivatives = state->derivatives;
    candidate->active = state->active;
    return ANHYST_OK;
  }
  p.from = p.sign * state->x;
  p.low = p.from;
  p.residual = fabs(residual);
  if (p.is_reversed) {
    p.active = 0;
    p.resting_m = p.sign * state->m;
    activate_cell(&p, p.from, 0.0);
  } else {
    p.active = state->active;
    p.resting_m = state->resting_m;
    p.derivatives = state->derivatives;
  }
  const int is_rising = 1.0 + omega * cells->max_slope > MIN_SLOPE;
  const anhyst_status status = is_rising ? solve_monotonic(&p, cells->max_slope, candidate)
                                         : solve_with_jumps(&p, candidate);
  if (status == ANHYST_OK && !(fabs(candidate->x) <= cells->x_max)) {
    return ANHYST_OUT_OF_RANGE;
  }
  return status;
}

void anhyst_cells_accept_f64(const anhyst_cells_f64 *cells, anhyst_cells_state_f64 *state,
                             const anhyst_cells_candidate_f64 *candidate)
{
  if (candidate->direction * state->direction <= 0.0) {
    for (int i = 0; i < state->active; i++) {
      state->play_position[i] = state->x - state->direction * cells->threshold[i];
    }
  }
  state->x = candidate->x;
  state->m = candidate->m;
  state->direction = candidate->direction;
  state->resting_m = candidate->resting_m;
  state->derivatives = candidate->derivatives;
  state->active = candidate->active;
}

static double clamp(double value, double low, double high)
{
  const double above = value > low ? value : low;
  return above < high ? above : high;
}

/* Returns the contribution of cell i > 0 at the play x - r_i: its row minus the previous row. */
static double cell_contribution(const anhyst_cells_f64 *cells, int i, double x)
{
  return cell_evaluate_row(cells, i, x).value - cell_evaluate_row(cells, i - 1, x).value;
}

void anhyst_cells_enter_f64(const anhyst_cells_f64 *cells, const double *numbers,
                            anhyst_cells_state_f64 *state)
{
  const anhyst_cells_bend_f64 zero = {0.0, 0.0, 0.0};
  const int is_number = !isnan(numbers[0]);
  state->x = is_number ? clamp(numbers[0], -cells->x_max, cells->x_max) : 0.0;
  state->play_position[0] = state->x;
  state->m = cell_evaluate_row(cells, 0, state->x).value;
  state->direction = 0.0;
  state->resting_m = 0.0;
  state->derivatives = zero;
  state->active = 0;
  for (int i = 1; i < cells->cells; i++) {
    /* Uses both sides of zero, so that a mirrored state has exactly the mirrored magnetisation. */
    const double r = cells->threshold[i];
    const double max_distance = r - cells->threshold[i - 1];
    const double previous_place = state->play_position[i - 1];
    const double place = isnan(numbers[i]) ? previous_place : numbers[i];
    state->play_position[i] =
        clamp(place, previous_place - max_distance, previous_place + max_distance);
    state->m += 0.5 * (cell_contribution(cells, i, state->play_position[i] + r) -
                       cell_contribution(cells, i, r - state->play_position[i]));
  }
}

void anhyst_cells_numbers_f64(const anhyst_cells_f64 *cells, const anhyst_cells_state_f64 *state,
                              double *numbers)
{
  numbers[0] = state->x;
  for (int i = 1; i < cells->cells; i++) {
    numbers[i] = i < state->active ? state->x - state->direction * cells->threshold[i]
                                   : state->play_position[i];
  }
}
