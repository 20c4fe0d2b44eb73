/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: play_map.c for q31, generic/play_map_real.h for the others. */

/* The current of a force whose value is i, before the limits of the current. */
static ANHYST_REAL current_of(const anhyst_play_map_x *c, ANHYST_REAL value, ANHYST_REAL force,
                              ANHYST_REAL gap)
{
  const ANHYST_REAL half = anhyst_map_value_x(&c->law->half, force, gap);
  const ANHYST_REAL over = anhyst_sub_x(value, c->play);
  return anhyst_add_x(value, pull(c->law, half, over));
}

ANHYST_REAL anhyst_play_map_solve_x(anhyst_play_map_x *c, ANHYST_REAL demand, ANHYST_REAL gap)
{
  c->demand = pulling(&c->law->map, demand);
  c->gap = gap;
  c->value = anhyst_map_value_x(&c->law->map, c->demand, gap);
  c->wanted = current_of(c, c->value, c->demand, gap);
  c->current = limited(c->wanted, c->low, c->high);
  c->solved = 1;
  c->flags = 0;
  if (c->demand != demand) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  if (c->current != c->wanted) {
    c->flags |= ANHYST_CURRENT_LIMITED;
  }
  return c->current;
}

/* One end of where the force of a current is looked for. */
typedef struct {
  ANHYST_REAL force;
  ANHYST_REAL value;   /* i there */
  ANHYST_REAL missing; /* of the current, above 0 at the lower end and below at the upper one */
} bracket_end;

typedef struct {
  bracket_end low;
  bracket_end high;
} bracket;

static bracket_end end_at(const anhyst_play_map_x *c, ANHYST_REAL force, ANHYST_REAL current,
                          ANHYST_REAL gap)
{
  bracket_end end;
  end.force = force;
  end.value = anhyst_map_value_x(&c->law->map, force, gap);
  end.missing = anhyst_sub_x(current, current_of(c, end.value, force, gap));
  return end;
}

/* Moves the one end or the other. */
static void take(bracket *in, bracket_end end)
{
  if (end.missing > 0) {
    in->low = end;
  } else {
    in->high = end;
  }
}

/* Columns between which a current belongs, by halves; both ends the nearest column where that lies
   beyond. */
static bracket between_columns(const anhyst_play_map_x *c, uint16_t first, uint16_t last,
                               ANHYST_REAL current, ANHYST_REAL gap)
{
  const anhyst_map_x *map = &c->law->map;
  bracket in;
  in.low = end_at(c, force_of(map, first), current, gap);
  in.high = end_at(c, force_of(map, last), current, gap);
  if (in.low.missing <= 0) {
    in.high = in.low;
  } else if (in.high.missing >= 0) {
    in.low = in.high;
  } else {
    uint16_t below = first;
    uint16_t above = last;
    while (above - below > 1) {
      const uint16_t middle = (uint16_t)((below + above) / 2);
      take(&in, end_at(c, force_of(map, middle), current, gap));
      if (in.low.force < force_of(map, middle)) {
        above = middle;
      } else {
        below = middle;
      }
    }
  }
  return in;
}

/* The same beside what was solved for, where mostly little is missing: as of a converter's grid. */
static bracket beside_solved(const anhyst_play_map_x *c, ANHYST_REAL current, ANHYST_REAL gap)
{
  const anhyst_map_x *map = &c->law->map;
  const uint16_t column = column_of(map, c->demand);
  const ANHYST_REAL missing = anhyst_sub_x(current, c->wanted);
  const bracket_end solved = {c->demand, c->value, missing};
  const uint16_t next = missing > 0 ? (uint16_t)(column + 1U) : column;
  const bracket_end other = end_at(c, force_of(map, next), current, gap);
  bracket in = {solved, solved};
  if (missing > 0 && other.missing > 0) {
    in = between_columns(c, next, columns_of(map), current, gap);
  } else if (missing <= 0 && other.missing <= 0) {
    in = between_columns(c, 0, next, current, gap);
  } else {
    take(&in, other);
  }
  return in;
}

/* Leaves out what lies beyond the force at which i is at an edge of the play. */
static void cut_at(const anhyst_play_map_x *c, ANHYST_REAL edge, ANHYST_REAL current,
                   ANHYST_REAL gap, bracket *in)
{
  if (in->low.value < edge && edge < in->high.value) {
    const ANHYST_REAL below = anhyst_sub_x(edge, in->low.value);
    const ANHYST_REAL above = anhyst_sub_x(in->high.value, edge);
    const ANHYST_REAL force = between(in->low.force, in->high.force, below, above);
    take(in, end_at(c, force, current, gap));
  }
}

/* Goes to where a current leads from the play there is. The current rises with the force and has
   two corners, where i is at an edge of the play; between corners and columns it is straight or a
   parabola: so by false position, the end that stays counting half as much from step to step. */
static void follow(anhyst_play_map_x *c, ANHYST_REAL current, ANHYST_REAL gap)
{
  const int at_gap = c->solved != 0U && gap == c->gap;
  bracket in = at_gap ? beside_solved(c, current, gap)
                      : between_columns(c, 0, columns_of(&c->law->map), current, gap);
  cut_at(c, anhyst_sub_x(c->play, c->law->radius), current, gap, &in);
  cut_at(c, anhyst_add_x(c->play, c->law->radius), current, gap, &in);
  bracket_end found = in.high.missing >= 0 ? in.high : in.low;
  ANHYST_REAL below = in.low.missing;
  ANHYST_REAL above = anhyst_sub_x(0, in.high.missing);
  int16_t side = 0;
  for (int16_t step = 0; step < ANHYST_PLAY_STEPS && below > 0 && above > 0; step++) {
    const ANHYST_REAL force = between(in.low.force, in.high.force, below, above);
    found = end_at(c, force, current, gap);
    if (is_nothing(c, found.missing)) {
      break;
    }
    take(&in, found);
    if (found.missing > 0) {
      below = found.missing;
      above = side > 0 ? above / 2 : above;
      side = 1;
    } else {
      above = anhyst_sub_x(0, found.missing);
      below = side < 0 ? below / 2 : below;
      side = -1;
    }
  }
  c->demand = found.force;
  c->value = found.value;
}

ANHYST_REAL anhyst_play_map_commit_x(anhyst_play_map_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL radius = c->law->radius;
  if (!is_known(applied)) {
    c->solved = 0;
    return c->demand;
  }
  if (c->solved == 0U || applied != c->wanted || gap != c->gap) {
    follow(c, applied, gap);
  }
  c->play = limited(c->play, anhyst_sub_x(c->value, radius), anhyst_add_x(c->value, radius));
  c->solved = 0;
  return c->demand;
}

anhyst_status anhyst_play_map_init_x(anhyst_play_map_x *c, const anhyst_play_law_x *law,
                                     ANHYST_REAL low, ANHYST_REAL high)
{
  const anhyst_play_map_x fresh = {0};
  if (anhyst_play_law_check_x(law) != ANHYST_OK || !is_known(low) || !is_known(high) ||
      low > high) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->law = law;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}
