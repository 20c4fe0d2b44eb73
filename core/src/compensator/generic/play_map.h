/* SPDX-License-Identifier: Apache-2.0 */
/* A template: the map with one play, the same text in every format. Before it are the operations of
   the format (../play_map.c or play_map_real.h), map.h and play_block.h. */

/* The rows of both tables at a gap. */
typedef struct {
  table_row map;
  table_row half;
} table_rows;

static table_rows rows_at(const law_type *law, number gap)
{
  table_rows at;
  at.map = row_at(&law->map, gap);
  at.half = at.map;
  at.half.first = law->half + (at.map.first - law->map.entries);
  return at;
}

/* Sets side and current of a point by its value and half-width. */
static void complete(const play_type *c, point *at)
{
  const number distance = subtract(at->value, c->play);
  if (distance >= c->law.radius) {
    at->side = ONE;
    at->current = at->value + at->half;
  } else if (distance <= -c->law.radius) {
    at->side = -ONE;
    at->current = at->value - at->half;
  } else {
    at->side = side_of(&c->law, distance);
    at->current = at->value + times(at->side, at->half);
  }
}

/* The point at a column; part is where this is in the segment looked at, 0 or 1. */
static point point_at(const play_type *c, const table_rows *rows, uint16_t column, number part)
{
  point at;
  at.part = part;
  at.value = at_column(&rows->map, column);
  at.half = at_column(&rows->half, column);
  complete(c, &at);
  return at;
}

/* The number at a part of the way between two. */
static number between(number from, number to, number part)
{
  return from + times(to - from, part);
}

static number solve(play_type *c, number demand, number gap)
{
  const table_rows rows = rows_at(&c->law, gap);
  c->demand = pulling(&c->law.map, demand);
  c->gap = gap;
  const place at = force_place(&c->law.map, c->demand);
  const uint16_t next = (uint16_t)(at.index + 1U);
  c->column = at.index;
  c->at.part = at.part;
  c->at.value = between(at_column(&rows.map, at.index), at_column(&rows.map, next), at.part);
  c->at.half = between(at_column(&rows.half, at.index), at_column(&rows.half, next), at.part);
  complete(c, &c->at);
  const number current = limited(c->at.current, c->low, c->high);
  c->solved = 1;
  c->flags = c->demand != demand ? ANHYST_DEMAND_LIMITED : 0U;
  if (current != c->at.current) {
    c->flags |= ANHYST_CURRENT_LIMITED;
  }
  return current;
}

/* Two points of a segment, on both sides of a current or at the end nearest to it. */
typedef struct {
  uint16_t column;
  point near;
  point far;
} stretch;

/* Bisects the columns between two for the segment of a current. */
static stretch bisect(const play_type *c, const table_rows *rows, uint16_t below, uint16_t above,
                      number current)
{
  while (above - below > 1) {
    const uint16_t middle = (uint16_t)((below + above) / 2);
    if (point_at(c, rows, middle, 0).current <= current) {
      below = middle;
    } else {
      above = middle;
    }
  }
  stretch in;
  in.column = below;
  in.near = point_at(c, rows, below, 0);
  in.far = point_at(c, rows, above, ONE);
  return in;
}

/* Begins at the point that was solved: the current is usually near, as on a converter's grid. */
static stretch search_from_solved(const play_type *c, const table_rows *rows, number current)
{
  const int is_above = current > c->at.current;
  const uint16_t next = is_above ? (uint16_t)(c->column + 1U) : c->column;
  const stretch in = {c->column, c->at, point_at(c, rows, next, is_above ? ONE : 0)};
  if (is_above ? in.far.current >= current : in.far.current <= current) {
    return in;
  }
  const uint16_t last = columns_of(&c->law.map);
  if (is_above) {
    return bisect(c, rows, next < last ? next : c->column, last, current);
  }
  return bisect(c, rows, 0, next > 0U ? next : 1U, current);
}

/* Leaves out what is beyond the corner at which the value is at an edge of the play. The current
   bends there. */
static void cut_at(number edge, number side, number current, stretch *in)
{
  point *near = &in->near;
  const int rises = near->value < in->far.value;
  if (rises ? near->value >= edge || edge >= in->far.value
            : near->value <= edge || edge <= in->far.value) {
    return;
  }
  const number x = share_of(size_of(edge - near->value), size_of(in->far.value - near->value));
  point corner;
  corner.part = between(near->part, in->far.part, x);
  corner.value = edge;
  corner.half = between(near->half, in->far.half, x);
  corner.side = side;
  corner.current = side > 0 ? edge + corner.half : edge - corner.half;
  if (rises ? corner.current < current : corner.current > current) {
    *near = corner;
  } else {
    in->far = corner;
  }
}

/* The part of the way from near to far at which the current is reached. Value, half and side are
   straight lines there, so that the current is

     near + x*(whole - bend*(1 - x)),  |bend| <= whole,

   and this is solved by Newton's steps from x = 0. */
static number part_of(const stretch *in, number current)
{
  number whole = difference(in->far.current, in->near.current);
  number missing = difference(current, in->near.current);
  number bend = times(difference(in->far.side, in->near.side), in->far.half - in->near.half);
  if (whole < 0) {
    whole = -whole;
    missing = -missing;
    bend = -bend;
  }
  if (missing <= 0) {
    return 0;
  }
  const number start = whole - bend;
  number x = share_of(missing, start);
  for (int16_t step = 0; step < PLAY_STEPS; step++) {
    const number turn = times(bend, x);
    const number left = missing - times(start + turn, x);
    if (is_rounding(left, in->near.current, in->far.current)) {
      break;
    }
    const number change = share_of(size_of(left), start + 2 * turn);
    if (left > 0) {
      x = change < ONE - x ? x + change : ONE;
    } else {
      x = change < x ? x - change : 0;
    }
  }
  return x;
}

/* Moves to the force to which a current leads from the play there is. */
static void follow(play_type *c, number current, number gap)
{
  const table_rows rows = rows_at(&c->law, gap);
  const int is_near = c->solved != 0U && gap == c->gap;
  stretch in = is_near ? search_from_solved(c, &rows, current)
                       : bisect(c, &rows, 0, columns_of(&c->law.map), current);
  cut_at(subtract(c->play, c->law.radius), -ONE, current, &in);
  cut_at(add(c->play, c->law.radius), ONE, current, &in);
  const number x = part_of(&in, current);
  const place at = {in.column, between(in.near.part, in.far.part, x)};
  c->demand = force_of(&c->law.map, at);
  c->at.value = between(in.near.value, in.far.value, x);
}

static number commit(play_type *c, number applied, number gap)
{
  const number radius = c->law.radius;
  if (is_known(applied)) {
    if (c->solved == 0U || applied != c->at.current || gap != c->gap) {
      follow(c, applied, gap);
    }
    c->play = limited(c->play, subtract(c->at.value, radius), add(c->at.value, radius));
  }
  c->solved = 0;
  return c->demand;
}
