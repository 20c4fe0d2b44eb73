/* SPDX-License-Identifier: Apache-2.0 */
/* Template for full.h: a path of the Jiles-Atherton law. On every path the field rises; a path with
   falling field is mirrored, which does not change the law. Along a path

     m = (1-c)*y + c*L(x),   y = A(p) + (y0 - A(b))*exp(-(p - b)/kappa)   for p > b = y_start,

   where L is the anhysteretic curve and A the ascending branch without reversible magnetisation,
   both tables. The play p follows the field x within its threshold. The effect of the history only
   decays. Therefore, the error of a table appears only once in y, for a path of any length. */

typedef struct {
  number x; /* field at the start of the path */
  number y;
  number p;
  number threshold;    /* threshold of the play */
  number tangent_step; /* longest Newton step without a new evaluation */
  /* set by find_y_start(): */
  table curve;
  table branch;
  table inverse;
  decay_rate decay;
  number reversal_play; /* play at the last reversal */
  number reversal_y;    /* y at the last reversal */
  number y_start;       /* play above which y changes */
  number offset;        /* reversal_y minus the ascending branch at y_start */
  entry offset_weight;  /* -offset as a weight, see to_quarter_weight() */
  number kappa;         /* field change in which the history's effect decays to 1/e */
  entry steepness;
  entry reversible;
  int16_t max_evaluations; /* maximum number of evaluations */
} branch_path;

typedef struct {
  number x;
  number y;
  number p;
  number m;
  slope y_slope; /* dy/dx */
  slope m_slope; /* dm/dx */
} path_point;

/* Limits a to -1..1 and to a lower bound in -1..1. */
static inline number limit_from_below(number a, number low)
{
  const number limited = limit_to_one(a);
  return limited > low ? limited : low;
}

/* Interpolates the table of an odd function at -1 <= u <= 1. */
static inline number interpolate_odd(table t, number u, number *rise)
{
  const mirror_type mirror = mirror_sign(u < 0);
  return mirrored(interpolate(t, mirrored(u, mirror), rise), mirror);
}

static inline number branch_value(const branch_path *path, number x, number *rise)
{
  return interpolate(path->branch, half(x + ONE), rise);
}

static inline number total_m(number y, number anhysteretic, entry reversible)
{
  return y + times_fraction(anhysteretic - y, reversible);
}

static inline table curve_table(const entry *words)
{
  return table_from_word(words, words[ANHYST_WORD_FULL_CURVE],
                         (uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS]);
}

static inline table inverse_table(const entry *words)
{
  return table_from_word(words, words[ANHYST_WORD_FULL_INVERSE],
                         (uint16_t)words[ANHYST_WORD_FULL_INVERSE_SEGMENTS]);
}

/* Limits a number of the stored state to -1..1, and mirrors it if the field falls. */
static inline number to_path_direction(number a, mirror_type mirror)
{
  return mirrored(limit_to_one(to_internal(a)), mirror);
}

static inline void init_branch_path(branch_path *path, const entry *words, const full_memory *from,
                                    mirror_type mirror)
{
  path->x = to_path_direction(from->x, mirror);
  path->y = to_path_direction(from->y, mirror);
  path->p = to_path_direction(from->p, mirror);
  path->threshold = times_fraction(ONE, words[ANHYST_WORD_FULL_PLAY]);
  path->tangent_step = max_tangent_step(words[ANHYST_WORD_FULL_STEEPNESS]);
}

/* Finds the last reversal of the play, the play at which y starts to change, and the offset of y
   from the ascending branch. The play reverses at the start of this path if it moved in the other
   direction before, or if it has not moved yet. y is constant until the anhysteretic curve has
   crossed it. An error of the crossing has almost no effect, because y starts with slope zero. */
static inline void find_y_start(branch_path *path, const entry *words, const full_memory *from,
                                mirror_type mirror)
{
  number rise;
  path->curve = curve_table(words);
  path->branch = table_from_word(words, words[ANHYST_WORD_FULL_BRANCH],
                                 (uint16_t)((uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS] + 1U));
  path->inverse = inverse_table(words);
  path->decay = read_decay_rate(words);
  path->steepness = words[ANHYST_WORD_FULL_STEEPNESS];
  path->reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  path->kappa = decay_field(path->steepness);
  path->max_evaluations = (int16_t)words[ANHYST_WORD_FULL_ITERATIONS];
  path->reversal_play = to_path_direction(from->reversal_play, mirror);
  path->reversal_y = to_path_direction(from->reversal_y, mirror);
  if (path->reversal_play >= path->p) {
    path->reversal_play = path->p;
    path->reversal_y = path->y;
  }
  const number crossing = interpolate_odd(path->inverse, path->reversal_y, &rise);
  path->y_start = crossing > path->reversal_play ? crossing : path->reversal_play;
  path->offset = path->reversal_y - branch_value(path, path->y_start, &rise);
  path->offset_weight = to_quarter_weight(-path->offset);
}

/* Returns the irreversible magnetisation at the play p. *y_slope is dy/dp. */
static inline number irreversible_m(const branch_path *path, number p, slope *y_slope)
{
  const number travel = p - path->y_start;
  if (travel <= 0) {
    *y_slope = 0;
    return path->y;
  }
  number rise;
  const number branch_y = branch_value(path, p, &rise);
  const number decayed = decayed_fraction_after(path->decay, travel);
  const number y = limit_from_below(
      branch_y + path->offset + times_quarter_weight(decayed, path->offset_weight), path->y);
  *y_slope = limit_slope(curve_slope(path->curve, rise) +
                         irreversible_slope(branch_y - y, path->steepness));
  return y;
}

/* Returns the point at the field x. While x is within the play, y stays exactly constant. */
static inline path_point evaluate_path(const branch_path *path, number x)
{
  path_point point = {x, path->y, path->p, 0, 0, 0};
  number rise;
  const number anhysteretic = interpolate_odd(path->curve, x, &rise);
  const number play_at_x = x - path->threshold;
  if (play_at_x >= path->p) {
    point.p = play_at_x;
    point.y = irreversible_m(path, play_at_x, &point.y_slope);
  }
  point.m = total_m(point.y, anhysteretic, path->reversible);
  point.m_slope = total_m_slope(point.y_slope, curve_slope(path->curve, rise), path->reversible);
  return point;
}

/* Sets the slopes at the start of a path whose y_start is known. The argument x_rise is the rise of
   the anhysteretic curve over the segment at the start. */
static inline void find_start_slopes(const branch_path *path, number x_rise, path_point *point)
{
  point->y_slope = 0;
  if (path->p >= path->y_start && path->x - path->p >= path->threshold - PLAY_ROUNDING) {
    number rise;
    const number anhysteretic_m = interpolate_odd(path->curve, path->p, &rise);
    point->y_slope = limit_slope(irreversible_slope(anhysteretic_m - path->y, path->steepness));
  }
  point->m_slope =
      total_m_slope(point->y_slope, curve_slope(path->curve, x_rise), path->reversible);
}

/* Moves a point along its tangents towards a field, by at most MAX_EXTRAPOLATION_STEP. */
static inline void follow_tangent(const branch_path *path, number goal, path_point *point)
{
  const number step = clamped(goal - point->x, -MAX_EXTRAPOLATION_STEP, MAX_EXTRAPOLATION_STEP);
  point->x += step;
  point->y = limit_from_below(point->y + multiply_by_slope(step, point->y_slope), path->y);
  point->m = limit_to_one(point->m + multiply_by_slope(step, point->m_slope));
  point->p = limit_from_below(point->x - path->threshold, path->p);
}

/* Returns whether the tangents at x are accurate up to the next field: the step is short, and y
   does not start to change within the step. */
static inline int is_tangent_accurate(const branch_path *path, number x, number next)
{
  const number contact_field = path->p + path->threshold - PLAY_ROUNDING;
  return absolute(next - x) <= path->tangent_step && (x >= contact_field || next <= contact_field);
}
