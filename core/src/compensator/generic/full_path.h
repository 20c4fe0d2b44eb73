/* SPDX-License-Identifier: Apache-2.0 */
/* Template: a path of the Jiles-Atherton law, for full.h. Every path rises: a falling one is
   mirrored, which does not change the law. Along a path

     m = (1-c)*y + c*L(x),   y = A(p) + (y0 - A(b))*exp(-(p - b)/kappa)   after the departure b,

   where L is the anhysteretic curve and A the ascending branch of fully pinned iron, both tables.
   The play p follows the field x within its half-width. The effect of the history only decays.
   Therefore, an error of a table appears in y at most once, for a path of any length. */

typedef struct {
  number x; /* start of the path */
  number y;
  number p;
  number play;         /* half-width */
  number tangent_step; /* longest step along a tangent without an evaluation */
  /* set by find_departure(): */
  table curve;
  table branch;
  table inverse;
  decay_rate decay;
  number turn;      /* play at the last reversal into this direction */
  number level;     /* y at that reversal */
  number departure; /* play at which y starts to move */
  number offset;    /* level - A(departure) */
  entry lead;       /* -offset as a weight, see lead_of() */
  number kappa;     /* field in which the effect of the history decays to 1/e */
  entry steepness;
  entry reversible;
  int16_t evaluations; /* maximum number */
} branch_path;

typedef struct {
  number x;
  number y;
  number p;
  number m;
  slope y_slope; /* dy/dx */
  slope m_slope; /* dm/dx */
} path_point;

/* Limits a to -1..1 and to at least `least`, which must be in -1..1. */
static inline number limit_from_below(number a, number least)
{
  const number inside = limit_to_unit(a);
  return inside > least ? inside : least;
}

/* Interpolates an odd table at -1 <= u <= 1. */
static inline number interpolate_odd(table t, number u, number *rise)
{
  const mirror_type mirror = mirror_for(u < 0);
  return mirrored(interpolate(t, mirrored(u, mirror), rise), mirror);
}

static inline number branch_value(const branch_path *path, number x, number *rise)
{
  return interpolate(path->branch, half(x + UNIT), rise);
}

static inline number magnetisation(number y, number anhysteretic, entry reversible)
{
  return y + multiply_by_part(anhysteretic - y, reversible);
}

static inline table curve_of(const entry *words)
{
  return table_at(words, words[ANHYST_WORD_FULL_CURVE],
                  (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS]);
}

static inline table inverse_of(const entry *words)
{
  return table_at(words, words[ANHYST_WORD_FULL_INVERSE],
                  (uint16_t)words[ANHYST_WORD_FULL_INVERSE_SEGMENTS]);
}

/* Converts a number of a memory to the direction of a path. */
static inline number on_path(number a, mirror_type mirror)
{
  return mirrored(limit_to_unit(to_inner(a)), mirror);
}

static inline void init_branch_path(branch_path *path, const entry *words, const full_memory *from,
                                    mirror_type mirror)
{
  path->x = on_path(from->x, mirror);
  path->y = on_path(from->y, mirror);
  path->p = on_path(from->p, mirror);
  path->play = multiply_by_part(UNIT, words[ANHYST_WORD_FULL_PLAY]);
  path->tangent_step = tangent_step_of(words[ANHYST_WORD_FULL_STEEPNESS]);
}

/* Finds the last reversal of the play, the departure of the irreversible part, and its offset from
   the branch. The play reverses here if it moved in the other direction, or not yet. y is constant
   until the anhysteretic curve has crossed it. An error of this crossing has almost no effect,
   because y departs with slope zero. */
static inline void find_departure(branch_path *path, const entry *words, const full_memory *from,
                                  mirror_type mirror)
{
  number rise;
  path->curve = curve_of(words);
  path->branch = table_at(words, words[ANHYST_WORD_FULL_BRANCH],
                          (uint16_t)((uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS] + 1U));
  path->inverse = inverse_of(words);
  path->decay = read_decay_rate(words);
  path->steepness = words[ANHYST_WORD_FULL_STEEPNESS];
  path->reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  path->kappa = kappa_of(path->steepness);
  path->evaluations = (int16_t)words[ANHYST_WORD_FULL_ITERATIONS];
  path->turn = on_path(from->turn, mirror);
  path->level = on_path(from->level, mirror);
  if (path->turn >= path->p) {
    path->turn = path->p;
    path->level = path->y;
  }
  const number crossing = interpolate_odd(path->inverse, path->level, &rise);
  path->departure = crossing > path->turn ? crossing : path->turn;
  path->offset = path->level - branch_value(path, path->departure, &rise);
  path->lead = lead_of(-path->offset);
}

/* Returns the irreversible magnetisation at the play p; *y_slope is dy/dp. */
static inline number irreversible_m(const branch_path *path, number p, slope *y_slope)
{
  const number travel = p - path->departure;
  if (travel <= 0) {
    *y_slope = 0;
    return path->y;
  }
  number rise;
  const number here = branch_value(path, p, &rise);
  const number decayed = decayed_share_after(path->decay, travel);
  const number y = limit_from_below(here + path->offset + lead_part(decayed, path->lead), path->y);
  *y_slope =
      limit_slope(slope_of(path->curve, rise) + irreversible_slope(here - y, path->steepness));
  return y;
}

/* Returns the point at x. While x is within the play, y does not change at all. */
static inline path_point evaluate(const branch_path *path, number x)
{
  path_point point = {x, path->y, path->p, 0, 0, 0};
  number rise;
  const number anhysteretic = interpolate_odd(path->curve, x, &rise);
  const number play_at_x = x - path->play;
  if (play_at_x >= path->p) {
    point.p = play_at_x;
    point.y = irreversible_m(path, play_at_x, &point.y_slope);
  }
  point.m = magnetisation(point.y, anhysteretic, path->reversible);
  point.m_slope = mixed_slope(point.y_slope, slope_of(path->curve, rise), path->reversible);
  return point;
}

/* Sets the slopes after the start of a path with a known departure; x_rise is the rise of the curve
   there. */
static inline void find_start_slopes(const branch_path *path, number x_rise, path_point *point)
{
  point->y_slope = 0;
  if (path->p >= path->departure && path->x - path->p >= path->play - PLAY_SLACK) {
    number rise;
    const number anhysteretic_m = interpolate_odd(path->curve, path->p, &rise);
    point->y_slope = limit_slope(irreversible_slope(anhysteretic_m - path->y, path->steepness));
  }
  point->m_slope = mixed_slope(point->y_slope, slope_of(path->curve, x_rise), path->reversible);
}

/* Moves a point along its tangents towards x, at most by MAX_EXTRAPOLATION. */
static inline void follow_tangent(const branch_path *path, number goal, path_point *point)
{
  const number step = clamped(goal - point->x, -MAX_EXTRAPOLATION, MAX_EXTRAPOLATION);
  point->x += step;
  point->y = limit_from_below(point->y + along_slope(step, point->y_slope), path->y);
  point->m = limit_to_unit(point->m + along_slope(step, point->m_slope));
  point->p = limit_from_below(point->x - path->play, path->p);
}

/* Returns whether the tangents are accurate up to a field: it is close, and y does not start to
   move before it. */
static inline int is_tangent_accurate(const branch_path *path, number x, number next)
{
  const number contact_field = path->p + path->play - PLAY_SLACK;
  return absolute(next - x) <= path->tangent_step && (x >= contact_field || next <= contact_field);
}
