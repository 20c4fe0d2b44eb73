/* SPDX-License-Identifier: Apache-2.0 */
/* Template: a path of the law of Jiles and Atherton, for full.h. Every path rises: a falling one is
   mirrored, which does not change the law. Along a path

     m = (1-c)*y + c*L(x),   y = A(p) + (y0 - A(b))*exp(-(p - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. The
   play p follows the field x at a distance. The memory only ever fades, so an error of a table
   appears in y at most once, whatever the length of the path. */

/* A rising path, prepared for evaluation at many places. */
typedef struct {
  const entry *words;
  table curve;
  table branch; /* this, inverse and fades: after depart() */
  table inverse;
  fading fades;
  number x; /* where it begins */
  number y;
  number p;
  number turn;      /* play where it turned into this direction ... */
  number level;     /* ... and y there */
  number play;      /* half-width */
  number departure; /* of the irreversible part, from there */
  number offset;    /* level - A(departure) */
  entry lead;       /* -offset, see lead_of() */
  entry steepness;
  entry reversible;
  number tangent_step; /* the longest step along a tangent without an evaluation */
} path;

/* A place on a path. */
typedef struct {
  number x;
  number y;
  number p;
  number m;
  slope y_slope; /* dy/dx */
  slope m_slope; /* dm/dx */
} answer;

/* a within -1..1, but not below `least`, which is. */
static inline number above(number a, number least)
{
  const number inside = within_unit(a);
  return inside > least ? inside : least;
}

/* An odd table, -1 <= u <= 1. */
static inline number odd_value(table t, number u, number *rise)
{
  const mirror way = mirror_of(u < 0);
  return turned(value(t, turned(u, way), rise), way);
}

/* A(x). */
static inline number branch_value(const path *along, number x, number *rise)
{
  return value(along->branch, half_of(x + UNIT), rise);
}

/* m = y + c*(L - y). */
static inline number magnetisation(const path *along, number y, number anhysteretic)
{
  return y + part_of(anhysteretic - y, along->reversible);
}

/* The field over the anhysteretic. */
static inline table inverse_of(const entry *words)
{
  return table_at(words, words[ANHYST_WORD_FULL_INVERSE],
                  exponent_of(words[ANHYST_WORD_FULL_INVERSE_SEGMENTS]));
}

/* A path from a memory whose direction is not known yet. */
static inline void prepare(path *along, const entry *words, const full_memory *from)
{
  along->words = words;
  along->curve = table_at(words, words[ANHYST_WORD_FULL_CURVE],
                          exponent_of(words[ANHYST_WORD_FULL_CURVE_SEGMENTS]));
  along->play = from_q15(words[ANHYST_WORD_FULL_PLAY]);
  along->steepness = words[ANHYST_WORD_FULL_STEEPNESS];
  along->reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  along->tangent_step = tangent_step_of(along->steepness);
  along->x = within_unit(to_inner(from->x));
  along->y = within_unit(to_inner(from->y));
  along->p = within_unit(to_inner(from->p));
  along->turn = within_unit(to_inner(from->turn));
  along->level = within_unit(to_inner(from->level));
}

/* Gives a path its direction. The play turns here if it moved the other way, or not yet. */
static inline void set_out(path *along, mirror way)
{
  along->x = turned(along->x, way);
  along->y = turned(along->y, way);
  along->p = turned(along->p, way);
  along->turn = turned(along->turn, way);
  along->level = turned(along->level, way);
  if (along->turn >= along->p) {
    along->turn = along->p;
    along->level = along->y;
  }
}

/* Finds where the irreversible part departs and what it has to forget. It is held until the
   anhysteretic has crossed y. An error of that place barely matters, since y leaves with slope
   zero. */
static void depart(path *along)
{
  const entry *words = along->words;
  number rise;
  along->branch = table_at(words, words[ANHYST_WORD_FULL_BRANCH],
                           exponent_of(words[ANHYST_WORD_FULL_CURVE_SEGMENTS]) + 1U);
  along->inverse = inverse_of(words);
  along->fades = fading_of(words);
  const number crossing = odd_value(along->inverse, along->level, &rise);
  along->departure = crossing > along->turn ? crossing : along->turn;
  along->offset = along->level - branch_value(along, along->departure, &rise);
  along->lead = lead_of(-along->offset);
}

/* The irreversible part where the play is at p; *y_slope is dy/dp. */
static inline number irreversible(const path *along, number p, slope *y_slope)
{
  const number travel = p - along->departure;
  if (travel <= 0) {
    *y_slope = 0;
    return along->y;
  }
  number rise;
  const number here = branch_value(along, p, &rise);
  const number gone = forgotten_along(along->fades, travel);
  const number y = above(here + along->offset + part_of_lead(gone, along->lead), along->y);
  *y_slope = rising(slope_of(along->curve, rise) + pulled(here - y, along->steepness));
  return y;
}

/* The place at x. While x is inside the play, y is exactly what it was. */
static inline void evaluate(const path *along, number x, answer *at)
{
  number rise;
  const number anhysteretic = odd_value(along->curve, x, &rise);
  const number pulls = x - along->play;
  at->x = x;
  at->p = along->p;
  at->y = along->y;
  at->y_slope = 0;
  if (pulls >= along->p) {
    at->p = pulls;
    at->y = irreversible(along, pulls, &at->y_slope);
  }
  at->m = magnetisation(along, at->y, anhysteretic);
  at->m_slope = mixed_slope(at->y_slope, slope_of(along->curve, rise), along->reversible);
}

/* The slopes beyond the start of a path that has departed. */
static void find_start_slopes(const path *along, answer *at)
{
  number x_rise;
  number p_rise;
  (void)odd_value(along->curve, along->x, &x_rise);
  at->y_slope = 0;
  if (along->p >= along->departure && along->x - along->p >= along->play - PLAY_SLACK) {
    const number pull = odd_value(along->curve, along->p, &p_rise);
    at->y_slope = rising(pulled(pull - along->y, along->steepness));
  }
  at->m_slope = mixed_slope(at->y_slope, slope_of(along->curve, x_rise), along->reversible);
}

/* Moves an answer along its tangents towards x, at most by MAX_SLIDE. */
static inline void slide(const path *along, number goal, answer *at)
{
  const number step = clamped(goal - at->x, -MAX_SLIDE, MAX_SLIDE);
  at->x += step;
  at->y = above(at->y + along_slope(step, at->y_slope), along->y);
  at->m = within_unit(at->m + along_slope(step, at->m_slope));
  at->p = above(at->x - along->play, along->p);
}
