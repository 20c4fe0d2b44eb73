/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: play_map.c for q31, generic/play_map_real.h for the others. */

/* The current of a force whose value is i, before the limits of the current. */
static ANHYST_REAL ANHYST_NAME(current_of)(const ANHYST_NAME(anhyst_play_map) *c, ANHYST_REAL value,
                                           ANHYST_REAL force, ANHYST_REAL gap)
{
  const ANHYST_REAL half = ANHYST_NAME(anhyst_map_value)(&c->law->half, force, gap);
  const ANHYST_REAL over = ANHYST_NAME(anhyst_sub)(value, c->play);
  return ANHYST_NAME(anhyst_add)(value, ANHYST_NAME(pull)(c->law, half, over));
}

ANHYST_REAL ANHYST_NAME(anhyst_play_map_solve)(ANHYST_NAME(anhyst_play_map) *c, ANHYST_REAL demand,
                                               ANHYST_REAL gap)
{
  c->demand = ANHYST_NAME(pulling)(&c->law->map, demand);
  c->gap = gap;
  c->value = ANHYST_NAME(anhyst_map_value)(&c->law->map, c->demand, gap);
  c->wanted = ANHYST_NAME(current_of)(c, c->value, c->demand, gap);
  c->current = ANHYST_NAME(limited)(c->wanted, c->low, c->high);
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
} ANHYST_NAME(end);

typedef struct {
  ANHYST_NAME(end) low;
  ANHYST_NAME(end) high;
} ANHYST_NAME(bracket);

static ANHYST_NAME(end) ANHYST_NAME(end_at)(const ANHYST_NAME(anhyst_play_map) *c,
                                            ANHYST_REAL force, ANHYST_REAL current, ANHYST_REAL gap)
{
  ANHYST_NAME(end) end;
  end.force = force;
  end.value = ANHYST_NAME(anhyst_map_value)(&c->law->map, force, gap);
  end.missing = ANHYST_NAME(anhyst_sub)(current, ANHYST_NAME(current_of)(c, end.value, force, gap));
  return end;
}

/* Moves the one end or the other. */
static void ANHYST_NAME(take)(ANHYST_NAME(bracket) *in, ANHYST_NAME(end) end)
{
  if (end.missing > 0) {
    in->low = end;
  } else {
    in->high = end;
  }
}

/* Columns between which a current belongs, by halves; both ends the nearest column where that lies
   beyond. */
static ANHYST_NAME(bracket)
    ANHYST_NAME(between_columns)(const ANHYST_NAME(anhyst_play_map) *c, uint16_t first,
                                 uint16_t last, ANHYST_REAL current, ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_map) *map = &c->law->map;
  ANHYST_NAME(bracket) in;
  in.low = ANHYST_NAME(end_at)(c, ANHYST_NAME(force_of)(map, first), current, gap);
  in.high = ANHYST_NAME(end_at)(c, ANHYST_NAME(force_of)(map, last), current, gap);
  if (in.low.missing <= 0) {
    in.high = in.low;
  } else if (in.high.missing >= 0) {
    in.low = in.high;
  } else {
    uint16_t below = first;
    uint16_t above = last;
    while (above - below > 1) {
      const uint16_t middle = (uint16_t)((below + above) / 2);
      ANHYST_NAME(take)(&in,
                        ANHYST_NAME(end_at)(c, ANHYST_NAME(force_of)(map, middle), current, gap));
      if (in.low.force < ANHYST_NAME(force_of)(map, middle)) {
        above = middle;
      } else {
        below = middle;
      }
    }
  }
  return in;
}

/* The same beside what was solved for, where mostly little is missing: as of a converter's grid. */
static ANHYST_NAME(bracket) ANHYST_NAME(beside_solved)(const ANHYST_NAME(anhyst_play_map) *c,
                                                       ANHYST_REAL current, ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_map) *map = &c->law->map;
  const uint16_t column = ANHYST_NAME(column_of)(map, c->demand);
  const ANHYST_REAL missing = ANHYST_NAME(anhyst_sub)(current, c->wanted);
  const ANHYST_NAME(end) solved = {c->demand, c->value, missing};
  const uint16_t next = missing > 0 ? (uint16_t)(column + 1U) : column;
  const ANHYST_NAME(end) other =
      ANHYST_NAME(end_at)(c, ANHYST_NAME(force_of)(map, next), current, gap);
  ANHYST_NAME(bracket) in = {solved, solved};
  if (missing > 0 && other.missing > 0) {
    in = ANHYST_NAME(between_columns)(c, next, ANHYST_NAME(columns_of)(map), current, gap);
  } else if (missing <= 0 && other.missing <= 0) {
    in = ANHYST_NAME(between_columns)(c, 0, next, current, gap);
  } else {
    ANHYST_NAME(take)(&in, other);
  }
  return in;
}

/* Leaves out what lies beyond the force at which i is at an edge of the play. */
static void ANHYST_NAME(cut_at)(const ANHYST_NAME(anhyst_play_map) *c, ANHYST_REAL edge,
                                ANHYST_REAL current, ANHYST_REAL gap, ANHYST_NAME(bracket) *in)
{
  if (in->low.value < edge && edge < in->high.value) {
    const ANHYST_REAL below = ANHYST_NAME(anhyst_sub)(edge, in->low.value);
    const ANHYST_REAL above = ANHYST_NAME(anhyst_sub)(in->high.value, edge);
    const ANHYST_REAL force = ANHYST_NAME(between)(in->low.force, in->high.force, below, above);
    ANHYST_NAME(take)(in, ANHYST_NAME(end_at)(c, force, current, gap));
  }
}

/* Goes to where a current leads from the play there is. The current rises with the force and has
   two corners, where i is at an edge of the play; between corners and columns it is straight or a
   parabola: so by false position, the end that stays counting half as much from step to step. */
static void ANHYST_NAME(follow)(ANHYST_NAME(anhyst_play_map) *c, ANHYST_REAL current,
                                ANHYST_REAL gap)
{
  const int at_gap = c->solved != 0U && gap == c->gap;
  ANHYST_NAME(bracket) in =
      at_gap
          ? ANHYST_NAME(beside_solved)(c, current, gap)
          : ANHYST_NAME(between_columns)(c, 0, ANHYST_NAME(columns_of)(&c->law->map), current, gap);
  ANHYST_NAME(cut_at)(c, ANHYST_NAME(anhyst_sub)(c->play, c->law->radius), current, gap, &in);
  ANHYST_NAME(cut_at)(c, ANHYST_NAME(anhyst_add)(c->play, c->law->radius), current, gap, &in);
  ANHYST_NAME(end) found = in.high.missing >= 0 ? in.high : in.low;
  ANHYST_REAL below = in.low.missing;
  ANHYST_REAL above = ANHYST_NAME(anhyst_sub)(0, in.high.missing);
  int16_t side = 0;
  for (int16_t step = 0; step < ANHYST_PLAY_STEPS && below > 0 && above > 0; step++) {
    const ANHYST_REAL force = ANHYST_NAME(between)(in.low.force, in.high.force, below, above);
    found = ANHYST_NAME(end_at)(c, force, current, gap);
    if (ANHYST_NAME(is_nothing)(c, found.missing)) {
      break;
    }
    ANHYST_NAME(take)(&in, found);
    if (found.missing > 0) {
      below = found.missing;
      above = side > 0 ? above / 2 : above;
      side = 1;
    } else {
      above = ANHYST_NAME(anhyst_sub)(0, found.missing);
      below = side < 0 ? below / 2 : below;
      side = -1;
    }
  }
  c->demand = found.force;
  c->value = found.value;
}

ANHYST_REAL ANHYST_NAME(anhyst_play_map_commit)(ANHYST_NAME(anhyst_play_map) *c,
                                                ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL radius = c->law->radius;
  if (!ANHYST_NAME(is_known)(applied)) {
    c->solved = 0;
    return c->demand;
  }
  if (c->solved == 0U || applied != c->wanted || gap != c->gap) {
    ANHYST_NAME(follow)(c, applied, gap);
  }
  c->play = ANHYST_NAME(limited)(c->play, ANHYST_NAME(anhyst_sub)(c->value, radius),
                                 ANHYST_NAME(anhyst_add)(c->value, radius));
  c->solved = 0;
  return c->demand;
}

anhyst_status ANHYST_NAME(anhyst_play_map_init)(ANHYST_NAME(anhyst_play_map) *c,
                                                const ANHYST_NAME(anhyst_play_law) *law,
                                                ANHYST_REAL low, ANHYST_REAL high)
{
  const ANHYST_NAME(anhyst_play_map) fresh = {0};
  if (ANHYST_NAME(anhyst_play_law_check)(law) != ANHYST_OK || !ANHYST_NAME(is_known)(low) ||
      !ANHYST_NAME(is_known)(high) || low > high) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->law = law;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}
