/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with its exact step, in fixed point.

   In the law's own units the iron follows h*x + m = flux, and a current gives
   flux_arm*flux + field_arm*x. Both are one equation, air*x + iron*m = target. Iron that couples
   to itself more than the gap parts it makes the flux arm, and so iron, negative; air stays above
   0, and the sum rises with x as long as m is nowhere steeper than air/-iron, which the check of a
   block asks for. So the solution is unique. Everything happens on a path that rises: a falling one
   is mirrored, which the law does not notice. Along a path

     m = (1-c)*y + c*L(x),   y = A(x) + (y0 - A(b))*exp(-(x - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. As
   the lag only ever forgets, an error of a table appears in y at most once, however long one goes
   on.

   Inside, everything is q28: sums of a few numbers stay far from the ends of 32 bits, and none
   needs to saturate. */
#include "full_path.h"

/* An interval of the field too long for a tangent to be trusted at its ends: 1/64. */
#define LONG_WAY (ONE / 64)

/* A step too short to matter, about what the tables leave unsure: 6e-5. */
#define SHORT_WAY (ONE / 16384)

/* Steps of the guess that follows the anhysteretic curve against the iron. */
#define CHORDS 4

/* A residual that is nothing but rounding: the iron stays where it is. */
#define STILL 32

/* What the law answers at one place of it. */
typedef struct {
  int32_t x;
  int32_t y;
  int32_t p;
  int32_t m;
  int32_t y_slope; /* dy/dx in 1/1024 */
  int32_t m_slope; /* dm/dx */
} answer;

/* a within -1..1, but not below least, which is. */
static int32_t above(int32_t a, int32_t least)
{
  const int32_t inside = anhyst_sat_q28(a);
  return inside > least ? inside : least;
}

/* A(x). */
static int32_t branch(const path *along, int32_t x, int32_t *rise)
{
  return value(along->branch, (x + ONE) >> 1, rise);
}

/* dy/dp in 1/1024 where what pulls stands so far above y. */
static int32_t pulled(const path *along, int32_t above)
{
  return ((above >> 15) * along->steepness) >> 11;
}

/* 1 - 2^(-t) for a way of t octaves, q26 in, q28 out. Below one octave a cubic for (1 - 2^-f)/f,
   whole octaves by shifting; error below 7e-5, and below 1.5e-4 of the result. */
static int32_t forgotten(int32_t way)
{
  const uint16_t whole = (uint16_t)(way >> 26) & 31U; /* way is not negative */
  const int32_t rest = way & 0x3FFFFFF;
  const int32_t f = rest >> 11; /* q15 */
  int32_t ratio = 1775 - ((241 * f) >> 15);
  ratio = 7863 - ((ratio * f) >> 15);
  ratio = 22713 - ((ratio * f) >> 15);
  return ONE - ((ONE - anhyst_scale(rest * 8, (int16_t)ratio)) >> whole);
}

/* The irreversible part where the play stands so far beyond the departure; *slope is dy/dp. */
static int32_t irreversible(const path *along, int32_t p, int32_t *slope)
{
  const int32_t way = p - along->departure;
  if (way <= 0) {
    *slope = 0;
    return along->y;
  }
  int32_t rise;
  const int32_t here = branch(along, p, &rise);
  const int32_t octaves = anhyst_scale(way * 4, along->rate);
  const int32_t most = ANHYST_Q31_MAX >> along->rate_shift; /* beyond, all is forgotten */
  const int32_t gone =
      octaves > most ? ONE : forgotten((int32_t)((uint32_t)octaves << along->rate_shift));
  const int32_t y = above(here + along->offset + anhyst_scale(gone, along->lead) * 4, along->y);
  *slope = anhyst_sat_u15(slope_of(along, rise) + pulled(along, here - y));
  return y;
}

static void evaluate(const path *along, int32_t x, answer *at)
{
  int32_t rise;
  const int32_t anhysteretic = odd_value(along->curve, x, &rise);
  at->x = x;
  if (x - along->play < along->p) { /* inside the play: what is irreversible rests, exactly */
    at->p = along->p;
    at->y = along->y;
    at->y_slope = 0;
  } else {
    at->p = x - along->play;
    at->y = irreversible(along, at->p, &at->y_slope);
  }
  at->m = magnetisation(along, at->y, anhysteretic);
  at->m_slope = slope_of_m(along, at->y_slope, slope_of(along, rise));
}

/* Finds where the irreversible part departs and what it has to forget. */
static void depart(path *along)
{
  const int16_t *words = along->words;
  int32_t rise;
  along->branch.at = words + words[ANHYST_WORD_FULL_BRANCH];
  along->branch.n = (uint16_t)(along->curve.n + 1U);
  along->inverse = inverse_of(words);
  along->rate = words[ANHYST_WORD_FULL_RATE];
  along->rate_shift = (uint16_t)words[ANHYST_WORD_FULL_RATE_SHIFT];
  /* Held until the anhysteretic has crossed y. Where that is exactly hardly matters, since y leaves
     with slope zero. */
  const int32_t crossing = odd_value(along->inverse, along->level, &rise);
  along->departure = crossing > along->turn ? crossing : along->turn;
  along->offset = along->level - branch(along, along->departure, &rise);
  along->lead = anhyst_sat_q15((0x2000 - along->offset) >> 14);
}

/* dy/dp at the start of a path that has departed. */
static int32_t slope_at_start(const path *along, int32_t anhysteretic)
{
  int32_t rise;
  if (along->p < along->departure || along->x - along->p < along->play) {
    return 0;
  }
  const int32_t pull =
      along->p == along->x ? anhysteretic : odd_value(along->curve, along->p, &rise);
  return anhyst_sat_u15(pulled(along, pull - along->y));
}

/* n*65536/d for n >= 0, d > 0, to 14 bits or exact; at most 4 (q28). */
static int32_t quotient(int32_t n, int32_t d)
{
  const uint16_t room = anhyst_headroom(n | 1);
  const uint16_t down = room < 16U ? (uint16_t)(16U - room) : 0U;
  const int32_t ratio = (int32_t)((uint32_t)n << (16U - down)) / d;
  const int32_t most = (ONE * 4 - 1) >> down;
  return (int32_t)((uint32_t)(ratio < most ? ratio : most) << down);
}

/* Whether a step stays inside the interval and is shorter by a quarter than the last one, since
   tangents can swing to and fro across the two bends of the curve; or is too short to matter. */
static int nearer(int32_t x, int32_t next, int32_t low, int32_t high, int32_t furthest)
{
  const int32_t way = next < x ? x - next : next - x;
  return way <= SHORT_WAY || (next > low && next < high && way <= furthest - (furthest >> 2));
}

/* air*x + iron*m = target along a rising path, and the interval known to hold the solution. */
typedef struct {
  int16_t air;
  int16_t iron;
  int32_t target;
  int32_t low;
  int32_t high;
  int32_t residual; /* at the last place looked at */
} search;

/* The same of a residual, in the direction that takes it away. */
static int32_t against(int32_t residual, int32_t slope)
{
  return residual < 0 ? quotient(-residual, slope) : -quotient(residual, slope);
}

/* Where the path would meet its target if m rose like the anhysteretic curve: a guess that holds
   over long ways, where a tangent does not. residual is that at x. */
static int32_t follow_curve(const path *along, const search *find, int32_t x, int32_t residual)
{
  int32_t rise;
  const int32_t start = odd_value(along->curve, x, &rise);
  if (find->iron >= 0) {
    /* The air hardly counts. */
    const int32_t level = start + against(residual, find->iron + 1);
    return odd_value(along->inverse, anhyst_sat_q28(level), &rise);
  }
  /* Iron that counts against the air: as far as the air alone would go, and on with what the iron
     has risen by then, which never goes too far. */
  int32_t next = x;
  int32_t missing = residual;
  for (int16_t i = 0; i < CHORDS; i++) {
    next = anhyst_sat_q28(x + against(missing, find->air));
    const int32_t risen = odd_value(along->curve, next, &rise) - start;
    missing = anhyst_clamp(residual + anhyst_scale(risen, find->iron), 1 - 2 * ONE, 2 * ONE - 1);
  }
  return next;
}

/* Looks at a place: narrows the interval, and gives where the tangent would meet the target. */
static int32_t look(search *find, const answer *at)
{
  const int32_t residual =
      anhyst_scale(at->x, find->air) + anhyst_scale(at->m, find->iron) - find->target;
  const int32_t slope = find->air + ((find->iron * at->m_slope) >> 10);
  const int32_t way = quotient(residual < 0 ? -residual : residual, slope > 0 ? slope : 1);
  find->residual = residual;
  if (residual < 0) {
    find->low = at->x;
    return at->x + way;
  }
  find->high = at->x;
  return at->x - way;
}

/* Moves an answer along its tangents towards x, no further than a tangent can be trusted. */
static void slide(const path *along, int32_t goal, answer *at)
{
  const int32_t way = anhyst_clamp(goal - at->x, -LONG_WAY, LONG_WAY);
  const int32_t x = at->x + way;
  at->x = x;
  at->y = above(at->y + anhyst_scale(way, (int16_t)at->y_slope) * 64, along->y);
  at->m = anhyst_sat_q28(at->m + anhyst_scale(way, (int16_t)at->m_slope) * 64);
  at->p = above(x - along->play, along->p);
}

/* Where to look first on a path that begins held, up to a known end: there m needs no evaluation
   and shows on which side the solution lies. The tangent at the start knows nothing of what comes
   after the end. */
static int32_t leave_hold(const path *along, search *find, int32_t end, int32_t tangent)
{
  int32_t rise;
  const int32_t m = magnetisation(along, along->y, odd_value(along->curve, end, &rise));
  const int32_t residual =
      anhyst_scale(end, find->air) + anhyst_scale(m, find->iron) - find->target;
  int32_t first = tangent;
  if (residual < 0) {
    find->low = end;
    first = follow_curve(along, find, end, residual);
  } else {
    find->high = end;
  }
  return anhyst_clamp(first, find->low, find->high);
}

/* Whether the tangents lead to a place: near, and not beyond where the play pulls y at once. */
static int is_near(const path *along, int32_t x, int32_t next)
{
  const int32_t way = next < x ? x - next : next - x;
  if (way > along->near) {
    return 0;
  }
  const int32_t taken_up = along->p + along->play;
  return x >= taken_up || next <= taken_up;
}

/* Solves from a place on the path, at whose start the residual is negative. Newton's steps inside
   an interval that always holds the solution; one that leaves it follows the anhysteretic curve
   instead, or goes to the middle: with iron that counts against the air, where the curve leads a
   little way at a time if the sum is all but flat, as soon as the last step was longer than what is
   left of the interval. The number of evaluations is bounded, and at least 1, since tangents at the
   start would add up errors of many short steps; the last step is taken along the tangents. */
static answer rise(const path *along, search find, int16_t evaluations, answer at)
{
  const int32_t moves = along->departure > along->p ? along->departure : along->p;
  const int32_t freed = moves + along->play;
  int32_t furthest = ANHYST_Q31_MAX;
  find.low = along->x;
  find.high = ONE - 1;
  int32_t next = look(&find, &at);
  for (int16_t i = 0; i < evaluations; i++) {
    const int32_t x = at.x;
    if (i == 0 && freed > x && freed < find.high) {
      next = leave_hold(along, &find, freed, next);
    } else if (nearer(x, next, find.low, find.high, furthest)) {
      next = anhyst_clamp(next, find.low, find.high);
      furthest = next < x ? x - next : next - x;
    } else {
      const int32_t before = furthest;
      furthest = find.high - find.low;
      next = find.low;
      if (furthest > LONG_WAY && (find.iron >= 0 || i < 2 || before < furthest)) {
        next = follow_curve(along, &find, x, find.residual);
      }
      if (next <= find.low || next >= find.high) {
        next = find.low + furthest / 2;
      }
    }
    evaluate(along, next, &at);
    next = look(&find, &at);
    if (is_near(along, at.x, next)) {
      break;
    }
  }
  slide(along, anhyst_clamp(next, find.low, find.high), &at);
  return at;
}

/* In the direction of a path, falling 0 or -1: -1 - a where it falls; -a could leave the range. */
static int32_t turned(int32_t a, int32_t falling)
{
  return (int32_t)((uint32_t)a ^ (uint32_t)falling);
}

/* Mirrors what falls, and lets the play turn where it moved the other way, or not yet. */
static void set_out(path *along, int32_t falling)
{
  along->x = turned(along->x, falling);
  along->y = turned(along->y, falling);
  along->p = turned(along->p, falling);
  along->turn = turned(along->turn, falling);
  along->level = turned(along->level, falling);
  if (along->turn >= along->p) {
    along->turn = along->p;
    along->level = along->y;
  }
}

/* What was found on a path, in q30 and in the direction it really had; where the play has not
   moved, it has not turned either. */
static void remember(const path *along, const anhyst_full_memory *from, int32_t falling,
                     const answer *at, anhyst_full_memory *to)
{
  const int moved = at->p != along->p;
  to->x = turned(at->x, falling) * 4;
  to->y = turned(at->y, falling) * 4;
  to->p = turned(at->p, falling) * 4;
  to->turn = moved ? turned(along->turn, falling) * 4 : from->turn;
  to->level = moved ? turned(along->level, falling) * 4 : from->level;
}

/* The slopes beyond the start of a path that has departed, from the anhysteretic there. */
static void rise_from_start(const path *along, int32_t anhysteretic, int32_t x_rise, answer *at)
{
  at->y_slope = slope_at_start(along, anhysteretic);
  at->m_slope = slope_of_m(along, at->y_slope, slope_of(along, x_rise));
}

static int32_t full_field(anhyst_compensator *c)
{
  const int16_t *words = c->words;
  const anhyst_full_memory *from = &c->memory.full;
  anhyst_candidate *to = &c->next;
  path along;
  search find = {0, 0, 0, 0, 0, 0};
  int32_t x_rise;
  prepare(&along, words, from);
  const int32_t anhysteretic = odd_value(along.curve, along.x, &x_rise);
  const int32_t m = magnetisation(&along, along.y, anhysteretic);
  find.air = words[ANHYST_WORD_FULL_AIR];
  find.iron = 16384;
  const int32_t target = c->flux >> 4;
  const int32_t residual = anhyst_scale(along.x, find.air) + anhyst_scale(m, find.iron) - target;
  const int32_t falling = residual > 0 ? -1 : 0;
  set_out(&along, falling);
  answer at = {along.x, along.y, along.p, turned(m, falling), 0, 0};
  to->way = 0;
  if (residual > STILL || residual < -STILL) {
    find.target = turned(target, falling);
    depart(&along);
    rise_from_start(&along, turned(anhysteretic, falling), x_rise, &at);
    at = rise(&along, find, words[ANHYST_WORD_FULL_ITERATIONS], at);
    to->way = falling == 0 ? 1 : -1;
  }
  remember(&along, from, falling, &at, &to->memory.full);
  to->m = turned(at.m, falling);
  to->y_slope = (int16_t)at.y_slope;
  to->m_slope = (int16_t)at.m_slope;
  return to->memory.full.x;
}

/* flux_arm*flux + field_arm*x at a place of the law: what makes up the current. */
static int32_t current_at(const int16_t *words, const anhyst_arms *arms, int32_t x, int32_t m)
{
  const int32_t flux = m + anhyst_scale(x, words[ANHYST_WORD_FULL_AIR]) * 4;
  return anhyst_scale(flux, arms->flux_arm) + anhyst_scale(x, arms->field_arm);
}

/* Sets the target so that here so much of it is missing: air and iron are rounded to 16 bits. */
static void aim(search *find, const answer *at, int32_t missing)
{
  find->target =
      anhyst_sat_q28(anhyst_scale(at->x, find->air) + anhyst_scale(at->m, find->iron) + missing);
}

/* The end of a solved path of the same start and direction. */
static answer end_of(const path *along, const anhyst_candidate *solved, int32_t falling)
{
  const answer at = {above(turned(solved->memory.full.x >> 2, falling), along->x),
                     above(turned(solved->memory.full.y >> 2, falling), along->y),
                     above(turned(solved->memory.full.p >> 2, falling), along->p),
                     anhyst_sat_q28(turned(solved->m, falling)),
                     solved->y_slope,
                     solved->m_slope};
  return at;
}

/* Moves the end of a solved path along its tangents, if they lead to the target. */
static int slid(const path *along, search find, answer *at)
{
  const int32_t next = look(&find, at);
  if (next < along->x || next >= ONE || !is_near(along, at->x, next)) {
    return 0;
  }
  slide(along, next, at);
  return 1;
}

static int32_t full_flux(anhyst_compensator *c, int32_t current)
{
  const int16_t *words = c->words;
  const anhyst_full_memory *from = &c->memory.full;
  const anhyst_arms *arms = &c->arms;
  anhyst_candidate *solved = &c->next;
  path along;
  search find = {0, 0, 0, 0, 0, 0};
  int32_t x_rise;
  prepare(&along, words, from);
  const int32_t anhysteretic = odd_value(along.curve, along.x, &x_rise);
  const int32_t m = magnetisation(&along, along.y, anhysteretic);
  const int32_t wanted = (current >> 2) - (arms->bias >> 2);
  const int32_t missing = wanted - current_at(words, arms, along.x, m);
  const int32_t falling = missing < 0 ? -1 : 0;
  set_out(&along, falling);
  answer at = {along.x, along.y, along.p, turned(m, falling), 0, 0};
  if (missing > STILL || missing < -STILL) {
    const int32_t air_arm = ((int32_t)words[ANHYST_WORD_FULL_AIR] * arms->flux_arm) >> 14;
    int32_t left = ANHYST_Q31_MAX;
    answer end = at;
    find.air = (int16_t)anhyst_clamp(arms->field_arm + air_arm, 1, ANHYST_Q15_MAX);
    find.iron = arms->flux_arm;
    if (solved->way == (falling == 0 ? 1 : -1)) {
      end = end_of(&along, solved, falling);
      left = turned(wanted, falling) - current_at(words, arms, end.x, end.m);
      aim(&find, &end, left);
    }
    if (left != ANHYST_Q31_MAX && slid(&along, find, &end)) {
      at = end;
    } else {
      depart(&along);
      if (anhyst_abs_q31(left) < turned(missing, falling)) {
        at = end;
      } else {
        rise_from_start(&along, turned(anhysteretic, falling), x_rise, &at);
        aim(&find, &at, turned(missing, falling));
      }
      at = rise(&along, find, words[ANHYST_WORD_FULL_ITERATIONS], at);
    }
  }
  remember(&along, from, falling, &at, &solved->memory.full);
  const int32_t x = solved->memory.full.x;
  const int32_t of_air = anhyst_shl_q31(anhyst_scale(x, words[ANHYST_WORD_FULL_AIR]), 2);
  return anhyst_add_q31(turned(at.m, falling) * 4, of_air);
}

const anhyst_kernel anhyst_kernel_full = {
    ANHYST_KIND_FULL, full_field, full_flux, anhyst_full_is_valid, anhyst_full_carry, 0, 0, 0};
