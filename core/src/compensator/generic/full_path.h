/* SPDX-License-Identifier: Apache-2.0 */
/* Template: a path of the law of Jiles and Atherton, for full.h. Every path rises: a falling one is
   mirrored, which does not change the law. Along a path

     m = (1-c)*y + c*L(x),   y = A(p) + (y0 - A(b))*exp(-(p - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. The
   play p follows the field x at a distance. The memory only ever fades, so an error of a table
   appears in y at most once, whatever the length of the path. */

/* A rising path. */
typedef struct {
  number x; /* where it begins */
  number y;
  number p;
  number play;         /* half-width */
  number tangent_step; /* the longest step along a tangent without an evaluation */
  /* After depart(): */
  table curve;
  table branch;
  table inverse;
  fading fades;
  number turn;      /* play where it turned into this direction ... */
  number level;     /* ... and y there */
  number departure; /* of the irreversible part, from there */
  number offset;    /* level - A(departure) */
  entry lead;       /* -offset, see lead_of() */
  number kappa;     /* the field in which the memory fades to 1/e */
  entry steepness;
  entry reversible;
  int16_t evaluations; /* at most */
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
static inline number magnetisation(number y, number anhysteretic, entry reversible)
{
  return y + part_of(anhysteretic - y, reversible);
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

/* A number of a memory on a path. */
static inline number on_path(number a, mirror way) { return turned(within_unit(to_inner(a)), way); }

/* A path from a memory. */
static inline void begin(path *along, const entry *words, const full_memory *from, mirror way)
{
  along->x = on_path(from->x, way);
  along->y = on_path(from->y, way);
  along->p = on_path(from->p, way);
  along->play = part_of(UNIT, words[ANHYST_WORD_FULL_PLAY]);
  along->tangent_step = tangent_step_of(words[ANHYST_WORD_FULL_STEEPNESS]);
}

/* Finds where the play turned, where the irreversible part departs and what it has to forget. The
   play turns here if it moved the other way, or not yet. y is held until the anhysteretic has
   crossed it. An error of that place barely matters, since y leaves with slope zero. */
static inline void depart(path *along, const entry *words, const full_memory *from, mirror way)
{
  number rise;
  along->curve = curve_of(words);
  along->branch = table_at(words, words[ANHYST_WORD_FULL_BRANCH],
                           (uint16_t)((uint16_t)words[ANHYST_WORD_FULL_CURVE_SEGMENTS] + 1U));
  along->inverse = inverse_of(words);
  along->fades = fading_of(words);
  along->steepness = words[ANHYST_WORD_FULL_STEEPNESS];
  along->reversible = words[ANHYST_WORD_FULL_REVERSIBLE];
  along->kappa = kappa_of(along->steepness);
  along->evaluations = (int16_t)words[ANHYST_WORD_FULL_ITERATIONS];
  along->turn = on_path(from->turn, way);
  along->level = on_path(from->level, way);
  if (along->turn >= along->p) {
    along->turn = along->p;
    along->level = along->y;
  }
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
static inline answer evaluate(const path *along, number x)
{
  answer at = {x, along->y, along->p, 0, 0, 0};
  number rise;
  const number anhysteretic = odd_value(along->curve, x, &rise);
  const number pulls = x - along->play;
  if (pulls >= along->p) {
    at.p = pulls;
    at.y = irreversible(along, pulls, &at.y_slope);
  }
  at.m = magnetisation(at.y, anhysteretic, along->reversible);
  at.m_slope = mixed_slope(at.y_slope, slope_of(along->curve, rise), along->reversible);
  return at;
}

/* The slopes beyond the start of a path that has departed; x_rise is that of the curve there. */
static inline void find_start_slopes(const path *along, number x_rise, answer *at)
{
  at->y_slope = 0;
  if (along->p >= along->departure && along->x - along->p >= along->play - PLAY_SLACK) {
    number rise;
    const number pull = odd_value(along->curve, along->p, &rise);
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

/* Whether the tangents lead to a place: near, and not beyond where the play begins to pull y. */
static inline int is_near(const path *along, number x, number next)
{
  const number taken_up = along->p + along->play - PLAY_SLACK;
  return absolute(next - x) <= along->tangent_step && (x >= taken_up || next <= taken_up);
}
