/* SPDX-License-Identifier: Apache-2.0 */
/* A template: the map with one play, the same text in every format. Before it are the operations of
   the format (../play_map.c or play_map_real.h), map.h and play_block.h. */

/* The law at a gap, with the play where it is. */
typedef struct {
  table_row map;
  table_row half;
  number descending; /* value up to which the current is on the descending branch */
  number ascending;  /* value from which on the current is on the ascending branch */
} section;

static section section_at(const play_type *c, number gap)
{
  section at;
  at.map = row_at(&c->law.map, gap);
  at.half = at.map;
  at.half.first = c->law.half + (at.map.first - c->law.map.entries);
  at.descending = subtract(c->play, c->law.radius);
  at.ascending = add(c->play, c->law.radius);
  return at;
}

/* bounded((value - b)/radius) */
static inline number side_at(const play_type *c, const section *at, number value)
{
  if (value >= at->ascending) {
    return ONE;
  }
  return value <= at->descending ? -ONE : side_of(&c->law, value - c->play);
}

/* value + half*side; exact on both branches. */
static inline number current_at(number value, number half, number side)
{
  if (side == ONE) {
    return value + half;
  }
  return side == -ONE ? value - half : value + times(side, half);
}

/* Sets a point to a column; part is where this is in the segment looked at, 0 or 1. */
static void set_column(point *at, const play_type *c, const section *of, size_t column, number part)
{
  at->part = part;
  at->value = at_column(&of->map, column);
  at->half = at_column(&of->half, column);
  at->side = side_at(c, of, at->value);
  at->current = current_at(at->value, at->half, at->side);
}

/* The number at a part of the way between two. */
static number between(number from, number to, number part) { return from + times(to - from, part); }

static uint16_t gap_flag(const play_type *c, number gap)
{
  return is_gap(&c->law.map, gap) ? 0U : ANHYST_GAP_LIMITED;
}

static number solve(play_type *c, number demand, number gap)
{
  const section of = section_at(c, gap);
  c->demand = pulling(&c->law.map, demand);
  c->gap = gap;
  const place at = force_place(&c->law.map, c->demand);
  const size_t next = at.index + 1U;
  c->column = (uint16_t)at.index;
  c->at.part = at.part;
  c->at.value = between(at_column(&of.map, at.index), at_column(&of.map, next), at.part);
  c->at.half = between(at_column(&of.half, at.index), at_column(&of.half, next), at.part);
  c->at.side = side_at(c, &of, c->at.value);
  c->at.current = current_at(c->at.value, c->at.half, c->at.side);
  const number current = limited(c->at.current, c->low, c->high);
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

/* The part of a segment in which a current is looked for. */
typedef struct {
  size_t column;
  const point *near; /* its ends: the search begins at near */
  const point *far;
  point low; /* room for them: the columns at both sides, and the corners between them */
  point high;
  point corners[2];
} stretch;

/* Returns the column that begins the segment of a current: the first or the last one between two
   columns if the current is beyond. Tries two columns, then bisects. */
static size_t find_column(const play_type *c, const section *of, size_t below, size_t above,
                          size_t probe, size_t second, number current)
{
  while (above - below > 1U) {
    const number value = at_column(&of->map, probe);
    const number half = at_column(&of->half, probe);
    if (current_at(value, half, side_at(c, of, value)) <= current) {
      below = probe;
    } else {
      above = probe;
    }
    probe = below < second && second < above ? second : (below + above) / 2U;
    second = 0;
  }
  return below;
}

/* Leaves out what is beyond a corner: the current bends where the value is at an edge of the play.
   Near and far are on two sides of the edge. */
static void cut_at(number edge, number side, number current, stretch *in, point *corner)
{
  const point *near = in->near;
  const point *far = in->far;
  const number x = fraction_of(size_of(edge - near->value), size_of(far->value - near->value));
  corner->part = between(near->part, far->part, x);
  corner->value = edge;
  corner->half = between(near->half, far->half, x);
  corner->side = side;
  corner->current = current_at(edge, corner->half, side);
  if (near->value < far->value ? corner->current < current : corner->current > current) {
    in->near = corner;
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
  number whole = difference(in->far->current, in->near->current);
  number missing = difference(current, in->near->current);
  number bend = 0;
  if (in->near->side != in->far->side) {
    bend = times(difference(in->far->side, in->near->side), in->far->half - in->near->half);
  }
  if (whole < 0) {
    whole = -whole;
    missing = -missing;
    bend = -bend;
  }
  if (missing <= 0) {
    return 0;
  }
  if (missing >= whole) {
    return ONE;
  }
  const number start = whole - bend;
  number x = share_of(missing, start);
  for (int16_t step = 0; step < PLAY_STEPS; step++) {
    const number turn = times(bend, x);
    const number left = missing - times(start + turn, x);
    if (is_rounding(left, in->near->current, in->far->current)) {
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

/* Finds the segment of a current. Usually it is the solved one, as on a converter's grid, or the
   next one. */
static void find_segment(const play_type *c, const section *of, int is_solved, number current,
                         stretch *in)
{
  size_t below = 0;
  size_t above = columns_of(&c->law.map);
  size_t probe = above / 2U;
  size_t second = 1U;
  in->near = &c->at;
  in->column = c->column;
  if (is_solved && current > c->at.current) {
    below = (size_t)c->column + 1U;
    probe = above - 1U;
    second = below + 1U;
    in->far = &in->high;
    set_column(&in->high, c, of, below, ONE);
    if (below == above || in->high.current >= current) {
      return;
    }
  } else if (is_solved) {
    above = c->column;
    probe = 1U;
    second = above - 1U;
    in->far = &in->low;
    set_column(&in->low, c, of, above, 0);
    if (above == 0U || in->low.current <= current) {
      return;
    }
  }
  in->column = find_column(c, of, below, above, probe, second, current);
  in->near = &in->low;
  in->far = &in->high;
  set_column(&in->low, c, of, in->column, 0);
  set_column(&in->high, c, of, in->column + 1U, ONE);
}

/* Moves to the force to which a current leads from the play there is. */
static void follow(play_type *c, int is_solved, number current, number gap)
{
  const section of = section_at(c, gap);
  stretch in;
  find_segment(c, &of, is_solved, current, &in);
  if (in.near->side != in.far->side) {
    if (in.near->side == -ONE || in.far->side == -ONE) {
      cut_at(of.descending, -ONE, current, &in, &in.corners[0]);
    }
    if (in.near->side == ONE || in.far->side == ONE) {
      cut_at(of.ascending, ONE, current, &in, &in.corners[1]);
    }
  }
  const number x = part_of(&in, current);
  const place at = {in.column, between(in.near->part, in.far->part, x)};
  c->demand = pulling(&c->law.map, force_of(&c->law.map, at));
  c->at.value = between(in.near->value, in.far->value, x);
}

static number commit(play_type *c, number applied, number gap)
{
  const int is_solved = c->solved != 0U && gap == c->gap;
  if (!is_solved) {
    c->flags = (uint16_t)((c->solved != 0U ? c->flags : 0U) | gap_flag(c, gap));
  }
  c->solved = 0;
  if (!is_solved || applied != c->at.current) {
    if (!(applied >= c->least && applied <= c->most)) {
      c->flags |= ANHYST_CURRENT_LIMITED;
    }
    if (!is_known(applied)) {
      return c->demand;
    }
    follow(c, is_solved, applied, gap);
  }
  const number radius = c->law.radius;
  c->play = limited(c->play, subtract(c->at.value, radius), add(c->at.value, radius));
  return c->demand;
}
