/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/law/cells.h"

#include <float.h>

#include "cell_table.h"

/* Below this slope of the equation it is walked along, not bracketed. */
static const double flattest = 1e-6;

/* A path in the direction of travel: places are x*sign, so that it always rises. */
typedef struct {
  const anhyst_cells_f64 *cells;
  const anhyst_cells_state_f64 *state;
  double sign, omega, target;
  double from;    /* where the path starts */
  double here;    /* reached so far: the equation's left side is below its target */
  double missing; /* by so much, > 0 */
  double rest;    /* what cells at rest add */
  anhyst_cells_bend_f64 bend;
  int active;
  int turned; /* the state was left in the other direction */
} path;

static double left_side(const path *p, double x, const cell_sum *at)
{
  return x + p->omega * (at->value + p->rest);
}

/* Where the next cell begins to move. */
static double next_start(const path *p)
{
  const int i = p->active;
  if (i >= p->cells->cells) {
    return HUGE_VAL;
  }
  const double r = p->cells->threshold[i];
  if (p->turned && i < p->state->active) {
    return p->from + 2.0 * r; /* it moved until the path turned round */
  }
  return p->sign * p->state->place[i] + r;
}

static anhyst_cells_bend_f64 bend_of(const cell_sum *at)
{
  const anhyst_cells_bend_f64 bend = {at->slope, at->curve, at->third};
  return bend;
}

/* Takes the next cell along from a place on; before: what the row in use is there. */
static void start_cell(path *p, double x, double before)
{
  const cell_sum with = cell_look(p->cells, p->active, x);
  p->rest -= with.value - before;
  p->bend = bend_of(&with);
  p->active++;
  if (p->active == p->cells->cells) {
    p->rest = 0.0; /* rounding does not add up from cycle to cycle */
  }
}

/* How far it is to the root of left = t + omega*(slope*t + curve/2*t^2 + third/6*t^3), to the
   third power of the way; a straight line's where the way is too long for that. */
static inline double way_to(double left, double omega, const anhyst_cells_bend_f64 *bend)
{
  const double inverse = 1.0 / (1.0 + omega * bend->slope);
  const double straight = left * inverse;
  const double inverse_omega = inverse * omega;
  const double second = (0.5 * inverse_omega * bend->curve) * straight;
  const double third = (inverse_omega * bend->third * (1.0 / 6.0)) * (straight * straight);
  const double off = third + second * (1.0 - 2.0 * second);
  return fabs(off) < 0.25 ? straight - straight * off : straight;
}

static void answer(const path *p, double x, const cell_sum *at, double t,
                   anhyst_cells_candidate_f64 *candidate)
{
  const double third = 0.5 * t * at->third;
  candidate->x = p->sign * (x + t);
  candidate->m = p->sign * (at->value + p->rest +
                            t * (at->slope + t * (0.5 * at->curve + third * (1.0 / 3.0))));
  candidate->direction = p->sign;
  candidate->rest = p->rest;
  candidate->bend.slope = at->slope + t * (at->curve + third);
  candidate->bend.curve = at->curve + t * at->third;
  candidate->bend.third = at->third;
  candidate->active = p->active;
}

/* What rounding alone leaves of the equation. */
static double rounding(const path *p, double x)
{
  return 4.0 * DBL_EPSILON * (fabs(x) + fabs(p->target) + fabs(p->omega) * p->cells->saturation);
}

/* Newton, with curvature, on the row in use from x, between here and a place where the left side is
   beyond. */
static anhyst_status polish(const path *p, double x, double beyond,
                            anhyst_cells_candidate_f64 *candidate)
{
  double low = p->here;
  double high = beyond;
  double longest = high - low;
  for (int i = 0; i < 200; i++) {
    const cell_sum at = cell_look(p->cells, p->active - 1, x);
    const anhyst_cells_bend_f64 bend = bend_of(&at);
    const double left = p->target - left_side(p, x, &at);
    const double step = way_to(left, p->omega, &bend);
    const double next = x + step;
    if (left > 0.0) {
      low = x;
    } else {
      high = x;
    }
    const int inside = next >= low && next <= high;
    if (inside && fabs(step) <= p->cells->tangent) {
      answer(p, x, &at, step, candidate);
      return ANHYST_OK;
    }
    /* Cells are looked up on the grid of the numbers where the path starts: beside a root at 0 the
       interval stays wide against x for ever. */
    const double finest = 2.0 * DBL_EPSILON * (fabs(x) + (i < 100 ? 0.0 : fabs(p->from)));
    if (fabs(left) <= rounding(p, x) || high - low <= finest) {
      answer(p, x, &at, 0.0, candidate);
      return ANHYST_OK;
    }
    if (inside && fabs(step) <= longest) {
      longest = 0.5 * fabs(step); /* Newton could swing to and fro across a bend for ever */
      x = next;
    } else {
      x = 0.5 * (low + high);
      longest = high - low;
    }
  }
  return ANHYST_NOT_CONVERGED;
}

/* From row to row while the solution lies beyond the start of the next cell; the left side rises.
   Most solutions lie before it: then the row there need not be looked up. */
static anhyst_status climb(path *p, double steepest, anhyst_cells_candidate_f64 *candidate)
{
  for (;;) {
    const double edge = next_start(p);
    const double guess = p->here + way_to(p->missing, p->omega, &p->bend);
    /* Rounding, of what was missing where the path starts too, could put the solution beyond. */
    const double least = 1.0 + p->omega * steepest;
    const double far = p->here + (p->omega > 0.0 ? p->missing : p->missing / least);
    double beyond = far + rounding(p, far) + 4.0 * DBL_EPSILON * fabs(p->here);
    if (guess < edge) {
      const anhyst_status status = polish(p, guess < beyond ? guess : beyond, beyond, candidate);
      if (status != ANHYST_OK || p->sign * candidate->x <= edge) {
        return status;
      }
    }
    const cell_sum at = cell_look(p->cells, p->active - 1, edge);
    const double missing = p->target - left_side(p, edge, &at);
    if (missing <= 0.0) {
      beyond = edge < beyond ? edge : beyond;
      return polish(p, 0.5 * (p->here + beyond), beyond, candidate);
    }
    start_cell(p, edge, at.value);
    p->here = edge > p->here ? edge : p->here;
    p->missing = missing;
  }
}

/* The next node of the tables after x. */
static double next_node(const anhyst_cells_f64 *cells, double x)
{
  const uint64_t bits = cell_bits_at(cells, x);
  const int shift = cells->shift[cell_octave(bits)];
  uint64_t number = bits >> shift;
  double node = x;
  if (x >= 0.0) {
    while (!(node > x)) {
      number++;
      node = (cell_place(number << shift) - 1.0) / cells->per_unit;
    }
    return node;
  }
  const double inner = -(cell_place(number << shift) - 1.0) / cells->per_unit;
  if (inner > x) {
    return inner;
  }
  const uint64_t before = (number << shift) - 1U;
  if (before < cell_bits(1.0)) {
    return 0.0;
  }
  const int finer = cells->shift[cell_octave(before)];
  return -(cell_place((before >> finer) << finer) - 1.0) / cells->per_unit;
}

/* Where between two places the left side is largest, its slope there changing sign; stops where it
   reaches the target. */
static double fold(const path *p, double low, double high)
{
  for (int i = 0; i < 60; i++) {
    const double middle = 0.5 * (low + high);
    const cell_sum at = cell_look(p->cells, p->active - 1, middle);
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

/* Piece by piece to the first place where the left side reaches its target: m may jump there. */
static anhyst_status walk(path *p, anhyst_cells_candidate_f64 *candidate)
{
  while (p->here < p->cells->reach) {
    const double edge = next_start(p);
    const double node = next_node(p->cells, p->here);
    const double end = edge < node ? edge : node;
    const cell_sum at = cell_look(p->cells, p->active - 1, end);
    const double missing = p->target - left_side(p, end, &at);
    if (missing <= 0.0) {
      return polish(p, 0.5 * (p->here + end), end, candidate);
    }
    if (1.0 + p->omega * p->bend.slope > 0.0 && 1.0 + p->omega * at.slope < 0.0) {
      const double top = fold(p, p->here, end);
      const cell_sum there = cell_look(p->cells, p->active - 1, top);
      if (left_side(p, top, &there) >= p->target) {
        return polish(p, 0.5 * (p->here + top), top, candidate);
      }
    }
    p->here = end > p->here ? end : p->here;
    p->missing = missing;
    p->bend = bend_of(&at);
    if (edge <= node) {
      start_cell(p, edge, at.value);
    }
  }
  return ANHYST_OUT_OF_RANGE;
}

anhyst_status anhyst_cells_solve_f64(const anhyst_cells_f64 *cells,
                                     const anhyst_cells_state_f64 *state, double omega, double r,
                                     anhyst_cells_candidate_f64 *candidate)
{
  const double missing = r - state->x - omega * state->m;
  if (!(fabs(missing) < 4.0 * (cells->reach + fabs(omega) * cells->saturation))) {
    return ANHYST_OUT_OF_RANGE;
  }
  if (!(1.0 + omega * cells->reversible > flattest)) {
    return ANHYST_REFUSED;
  }
  path p;
  p.sign = missing < 0.0 ? -1.0 : 1.0;
  p.turned = p.sign * state->direction <= 0.0;
  p.cells = cells;
  p.state = state;
  p.omega = omega;
  p.target = p.sign * r;
  if (fabs(missing) <= rounding(&p, state->x)) {
    candidate->x = state->x;
    candidate->m = state->m;
    candidate->direction = state->direction;
    candidate->rest = state->rest;
    candidate->bend = state->bend;
    candidate->active = state->active;
    return ANHYST_OK;
  }
  p.from = p.sign * state->x;
  p.here = p.from;
  p.missing = fabs(missing);
  if (p.turned) {
    p.active = 0;
    p.rest = p.sign * state->m;
    start_cell(&p, p.from, 0.0);
  } else {
    p.active = state->active;
    p.rest = state->rest;
    p.bend = state->bend;
  }
  const int rises = 1.0 + omega * cells->steepest > flattest;
  const anhyst_status status = rises ? climb(&p, cells->steepest, candidate) : walk(&p, candidate);
  if (status == ANHYST_OK && !(fabs(candidate->x) <= cells->reach)) {
    return ANHYST_OUT_OF_RANGE;
  }
  return status;
}

void anhyst_cells_accept_f64(const anhyst_cells_f64 *cells, anhyst_cells_state_f64 *state,
                             const anhyst_cells_candidate_f64 *candidate)
{
  if (candidate->direction * state->direction <= 0.0) {
    for (int i = 0; i < state->active; i++) {
      state->place[i] = state->x - state->direction * cells->threshold[i];
    }
  }
  state->x = candidate->x;
  state->m = candidate->m;
  state->direction = candidate->direction;
  state->rest = candidate->rest;
  state->bend = candidate->bend;
  state->active = candidate->active;
}

/* value within low and high; low where it is not a number. */
static double clip(double value, double low, double high)
{
  const double above = value > low ? value : low;
  return above < high ? above : high;
}

/* What cell i > 0 adds at x - r_i, from the row with it and the row without. */
static double added(const anhyst_cells_f64 *cells, int i, double x)
{
  return cell_look(cells, i, x).value - cell_look(cells, i - 1, x).value;
}

void anhyst_cells_enter_f64(const anhyst_cells_f64 *cells, const double *numbers,
                            anhyst_cells_state_f64 *state)
{
  const anhyst_cells_bend_f64 level = {0.0, 0.0, 0.0};
  const int is_number = !isnan(numbers[0]);
  state->x = is_number ? clip(numbers[0], -cells->reach, cells->reach) : 0.0;
  state->place[0] = state->x;
  state->m = cell_look(cells, 0, state->x).value;
  state->direction = 0.0;
  state->rest = 0.0;
  state->bend = level;
  state->active = 0;
  for (int i = 1; i < cells->cells; i++) {
    /* From both sides, so that a mirrored state has the mirrored magnetisation to the last bit. */
    const double r = cells->threshold[i];
    const double room = r - cells->threshold[i - 1];
    const double near = state->place[i - 1];
    const double place = isnan(numbers[i]) ? near : numbers[i];
    state->place[i] = clip(place, near - room, near + room);
    state->m += 0.5 * (added(cells, i, state->place[i] + r) - added(cells, i, r - state->place[i]));
  }
}

void anhyst_cells_numbers_f64(const anhyst_cells_f64 *cells, const anhyst_cells_state_f64 *state,
                              double *numbers)
{
  numbers[0] = state->x;
  for (int i = 1; i < cells->cells; i++) {
    numbers[i] =
        i < state->active ? state->x - state->direction * cells->threshold[i] : state->place[i];
  }
}
