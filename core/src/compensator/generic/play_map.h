/* SPDX-License-Identifier: Apache-2.0 */
/* Template: the map with one play operator, for every number format. The operations of a format
   (../play_map.c or play_map_real.h), map.h and play_block.h are included before. */

/* The map and the half-widths of the loop at one gap, with the present play. */
typedef struct {
  table_row map;
  table_row half;
  number descending; /* largest map value whose current is on the descending branch */
  number ascending;  /* smallest map value whose current is on the ascending branch */
} gap_law;

static gap_law law_at_gap(const play_type *c, number gap)
{
  gap_law found;
  found.map = row_at_gap(&c->law.map, gap);
  found.half = found.map;
  found.half.first = c->law.half + (found.map.first - c->law.map.entries);
  found.descending = subtract(c->play, c->law.radius);
  found.ascending = add(c->play, c->law.radius);
  return found;
}

/* Returns (value - play)/radius, limited to -1 (descending branch) .. 1 (ascending branch). */
static inline number branch_position_at(const play_type *c, const gap_law *at, number value)
{
  if (value >= at->ascending) {
    return ONE;
  }
  return value <= at->descending ? -ONE : branch_position_from_distance(&c->law, value - c->play);
}

/* Returns value + half*side. The result is exact on both branches. */
static inline number current_at(number value, number half, number side)
{
  if (side == ONE) {
    return value + half;
  }
  return side == -ONE ? value - half : value + times_fraction(side, half);
}

/* Sets a point to a column. The argument `part` is 0 or 1: start or end of the searched segment. */
static void set_point_to_column(point *at, const play_type *c, const gap_law *slice, size_t column,
                                number part)
{
  at->fraction = part;
  at->value = column_value(&slice->map, column);
  at->half_width = column_value(&slice->half, column);
  at->side = branch_position_at(c, slice, at->value);
  at->current = current_at(at->value, at->half_width, at->side);
}

static number interpolate_between(number from, number to, number part)
{
  return from + times_fraction(to - from, part);
}

static uint16_t gap_flag(const play_type *c, number gap)
{
  return is_gap_in_range(&c->law.map, gap) ? 0U : ANHYST_GAP_LIMITED;
}

static number solve_demand(play_type *c, number demand, number gap)
{
  const gap_law slice = law_at_gap(c, gap);
  c->demand = limit_demand(&c->law.map, demand);
  c->gap = gap;
  const table_position position = locate_force(&c->law.map, c->demand);
  const size_t next = position.index + 1U;
  c->column = (uint16_t)position.index;
  c->at.fraction = position.fraction;
  c->at.value = interpolate_between(column_value(&slice.map, position.index),
                                    column_value(&slice.map, next), position.fraction);
  c->at.half_width = interpolate_between(column_value(&slice.half, position.index),
                                         column_value(&slice.half, next), position.fraction);
  c->at.side = branch_position_at(c, &slice, c->at.value);
  c->at.current = current_at(c->at.value, c->at.half_width, c->at.side);
  const number current = clamp(c->at.current, c->low, c->high);
  c->solved = 1;
  uint16_t flags = gap_flag(c, gap);
  if (c->demand != demand) {
    flags |= ANHYST_DEMAND_LIMITED;
  }
  if (current != c->at.current) {
    flags |= ANHYST_CURRENT_LIMITED;
  }
  c->flags = flags;
  return current;
}

/* Interval of a segment in which a current is searched for. */
typedef struct {
  size_t column;
  const point *start; /* ends of the interval; a search begins at the first */
  const point *end;
  point low; /* storage of the ends: adjacent columns, and corners between them */
  point high;
  point corners[2];
} search_interval;

/* Returns the column at the start of the segment that contains a current, in a range of columns, or
   the first or last segment for a current outside. Tries two columns first, then bisects. */
static size_t find_column(const play_type *c, const gap_law *slice, size_t below, size_t above,
                          size_t probe, size_t second, number current)
{
  while (above - below > 1U) {
    const number value = column_value(&slice->map, probe);
    const number half = column_value(&slice->half, probe);
    if (current_at(value, half, branch_position_at(c, slice, value)) <= current) {
      below = probe;
    } else {
      above = probe;
    }
    probe = below < second && second < above ? second : (below + above) / 2U;
    second = 0;
  }
  return below;
}

/* Splits the interval at a corner of the current, where the map value is at an end of the play.
   Requires that the ends of the interval are on different sides of the corner. */
static void split_at_corner(number corner_value, number side, number current, search_interval *span,
                            point *corner)
{
  const point *start = span->start;
  const point *end = span->end;
  const number x =
      precise_quotient(absolute(corner_value - start->value), absolute(end->value - start->value));
  corner->fraction = interpolate_between(start->fraction, end->fraction, x);
  corner->value = corner_value;
  corner->half_width = interpolate_between(start->half_width, end->half_width, x);
  corner->side = side;
  corner->current = current_at(corner_value, corner->half_width, side);
  if (start->value < end->value ? corner->current < current : corner->current > current) {
    span->start = corner;
  } else {
    span->end = corner;
  }
}

/* Returns the position between `start` and `end` at which the current is reached, 0..1. Value, half
   and side are linear in this interval, so that the current is

     start + x*(whole - bend*(1 - x)),  |bend| <= whole.

   Newton steps from x = 0 solve this equation. */
static number solve_in_interval(const search_interval *span, number current)
{
  number total_rise = difference(span->end->current, span->start->current);
  number residual = difference(current, span->start->current);
  number bend = 0;
  if (span->start->side != span->end->side) {
    bend = times_fraction(difference(span->end->side, span->start->side),
                          span->end->half_width - span->start->half_width);
  }
  if (total_rise < 0) {
    total_rise = -total_rise;
    residual = -residual;
    bend = -bend;
  }
  if (residual <= 0) {
    return 0;
  }
  if (residual >= total_rise) {
    return ONE;
  }
  const number start = total_rise - bend;
  number x = quotient_up_to_one(residual, start);
  for (int16_t i = 0; i < MAX_NEWTON_STEPS; i++) {
    const number bend_at_x = times_fraction(bend, x);
    const number remaining = residual - times_fraction(start + bend_at_x, x);
    if (is_rounding_error(remaining, span->start->current, span->end->current)) {
      break;
    }
    const number step_size = quotient_up_to_one(absolute(remaining), start + 2 * bend_at_x);
    if (remaining > 0) {
      x = step_size < ONE - x ? x + step_size : ONE;
    } else {
      x = step_size < x ? x - step_size : 0;
    }
  }
  return x;
}

/* Finds the segment of a current. A current that a D/A converter rounded is usually in the segment
   of the last solve or in an adjacent segment. */
static void find_segment(const play_type *c, const gap_law *slice, int is_solved, number current,
                         search_interval *span)
{
  size_t below = 0;
  size_t above = columns_of(&c->law.map);
  size_t probe = above / 2U;
  size_t second = 1U;
  span->start = &c->at;
  span->column = c->column;
  if (is_solved && current > c->at.current) {
    below = (size_t)c->column + 1U;
    probe = above - 1U;
    second = below + 1U;
    span->end = &span->high;
    set_point_to_column(&span->high, c, slice, below, ONE);
    if (below == above || span->high.current >= current) {
      return;
    }
  } else if (is_solved) {
    above = c->column;
    probe = 1U;
    second = above - 1U;
    span->end = &span->low;
    set_point_to_column(&span->low, c, slice, above, 0);
    if (above == 0U || span->low.current <= current) {
      return;
    }
  }
  span->column = find_column(c, slice, below, above, probe, second, current);
  span->start = &span->low;
  span->end = &span->high;
  set_point_to_column(&span->low, c, slice, span->column, 0);
  set_point_to_column(&span->high, c, slice, span->column + 1U, ONE);
}

/* Sets the force that corresponds to a current, starting from the present play. */
static void move_to_current(play_type *c, int is_solved, number current, number gap)
{
  const gap_law slice = law_at_gap(c, gap);
  search_interval span;
  find_segment(c, &slice, is_solved, current, &span);
  if (span.start->side != span.end->side) {
    if (span.start->side == -ONE || span.end->side == -ONE) {
      split_at_corner(slice.descending, -ONE, current, &span, &span.corners[0]);
    }
    if (span.start->side == ONE || span.end->side == ONE) {
      split_at_corner(slice.ascending, ONE, current, &span, &span.corners[1]);
    }
  }
  const number x = solve_in_interval(&span, current);
  const table_position position = {
      span.column, interpolate_between(span.start->fraction, span.end->fraction, x)};
  c->demand = limit_demand(&c->law.map, force_at_position(&c->law.map, position));
  c->at.value = interpolate_between(span.start->value, span.end->value, x);
}

static number commit_current(play_type *c, number applied, number gap)
{
  const int is_solved = c->solved != 0U && gap == c->gap;
  if (!is_solved) {
    c->flags = (uint16_t)((c->solved != 0U ? c->flags : 0U) | gap_flag(c, gap));
  }
  c->solved = 0;
  if (!is_solved || applied != c->at.current) {
    if (!(applied >= c->tolerated_low && applied <= c->tolerated_high)) {
      c->flags |= ANHYST_CURRENT_LIMITED;
    }
    if (!is_finite(applied)) {
      return c->demand;
    }
    move_to_current(c, is_solved, applied, gap);
  }
  const number radius = c->law.radius;
  c->play = clamp(c->play, subtract(c->at.value, radius), add(c->at.value, radius));
  return c->demand;
}
