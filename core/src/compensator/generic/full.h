/* SPDX-License-Identifier: Apache-2.0 */
/* The effective-field law with its exact step, in floating point.

   In the law's own units the iron follows h*x + m = flux, and a current gives
   flux_arm*flux + field_arm*x. Both are one equation, air*x + iron*m = target. Iron that couples
   to itself more than the gap parts it makes the flux arm, and so iron, negative; air stays above
   0, and the sum rises with x as long as m is nowhere steeper than air/-iron, which the check of
   the parameters asks for. So the solution is unique. Everything happens on a path that rises: a
   falling one is mirrored, which the law does not notice. Along a path

     m = (1-c)*y + c*L(x),   y = A(x) + (y0 - A(b))*exp(-(x - b)/kappa)   beyond the departure b,

   with L the anhysteretic curve and A the ascending branch of a fully pinned iron, both tables. */

/* Steps of the guess that follows the anhysteretic curve against the iron. */
#define CHORDS 4U

/* A rising path, prepared for evaluation at many places. */
typedef struct {
  const anhyst_full_law_x *law;
  anhyst_full_memory_x from;
  ANHYST_REAL scale;     /* segments for a unit of field */
  ANHYST_REAL short_way; /* a step too short to matter, about what the tables leave unsure */
  ANHYST_REAL long_way;  /* an interval too long for a tangent to be trusted at its ends */
  ANHYST_REAL turn;      /* play where it turned */
  ANHYST_REAL level;     /* irreversible part there */
  ANHYST_REAL departure; /* of the irreversible part */
  ANHYST_REAL branch;    /* A there */
} path;

/* What the law answers at one place of it. */
typedef struct {
  ANHYST_REAL x;
  ANHYST_REAL y;
  ANHYST_REAL p;
  ANHYST_REAL m;
  ANHYST_REAL y_slope; /* dy/dx */
  ANHYST_REAL m_slope; /* dm/dx */
} answer;

/* L(x) and its slope. */
static ANHYST_REAL curve(const path *along, ANHYST_REAL x, ANHYST_REAL *slope)
{
  const ANHYST_REAL *table = along->law->curve;
  const anhyst_spot_x spot =
      anhyst_spot_of_x(along->law->curve_segments, anhyst_size_x(x) * along->scale);
  const ANHYST_REAL value = anhyst_value_at_x(table, spot);
  *slope = anhyst_rise_at_x(table, spot) * along->scale;
  return x < R(0.0) ? -value : value;
}

/* A(x) and its slope. */
static ANHYST_REAL branch(const path *along, ANHYST_REAL x, ANHYST_REAL *slope)
{
  const ANHYST_REAL *table = along->law->branch;
  const anhyst_spot_x spot = anhyst_spot_of_x((uint16_t)(2U * along->law->curve_segments),
                                              (x + along->law->reach) * along->scale);
  *slope = anhyst_rise_at_x(table, spot) * along->scale;
  return anhyst_value_at_x(table, spot);
}

/* The field at which L reaches y. */
static ANHYST_REAL inverse_curve(const anhyst_full_law_x *law, ANHYST_REAL y)
{
  const anhyst_spot_x spot = anhyst_spot_of_x(
      law->inverse_segments, anhyst_size_x(y) * (ANHYST_REAL)law->inverse_segments);
  const ANHYST_REAL value = anhyst_value_at_x(law->inverse, spot);
  return y < R(0.0) ? -value : value;
}

/* 1 - 2^(-t) for a way of t octaves, t >= 0. Below one octave a polynomial for (1 - 2^-f)/f, whole
   octaves by an exact power of two. Error below 1e-9 before rounding, relative to t where t is
   small. */
static ANHYST_REAL forgotten(ANHYST_REAL t)
{
  if (t >= R(31.0)) {
    return R(1.0);
  }
  const uint16_t whole = (uint16_t)t;
  const ANHYST_REAL f = t - (ANHYST_REAL)whole;
  ANHYST_REAL ratio = R(0.0013299398836141) + f * (R(-1.488923773820e-4) + f * R(1.13038439e-5));
  ratio = R(0.0555039138729150) + f * (R(-0.0096169507101000) + f * ratio);
  ratio = R(0.6931471804363274) + f * (R(-0.2402264948347643) + f * ratio);
  return R(1.0) - (R(1.0) - f * ratio) / (ANHYST_REAL)((uint32_t)1 << whole);
}

static ANHYST_REAL magnetisation(const path *along, ANHYST_REAL y, ANHYST_REAL anhysteretic)
{
  return y + along->law->reversible * (anhysteretic - y);
}

/* dy/dp where what pulls stands so far above y. */
static ANHYST_REAL pulled(const path *along, ANHYST_REAL above)
{
  return R(0.6931471805599453) * along->law->octaves * above;
}

/* The irreversible part where the play stands at p; *slope is dy/dp. */
static ANHYST_REAL irreversible(const path *along, ANHYST_REAL p, ANHYST_REAL *slope)
{
  *slope = R(0.0);
  if (p <= along->departure) {
    return along->from.y;
  }
  ANHYST_REAL rise;
  const ANHYST_REAL here = branch(along, p, &rise);
  const ANHYST_REAL gone = forgotten((p - along->departure) * along->law->octaves);
  const ANHYST_REAL risen = (along->branch - along->level) * gone + (here - along->branch);
  const ANHYST_REAL y = anhyst_limited_x(along->level + risen, along->from.y, R(1.0));
  const ANHYST_REAL steep = rise + pulled(along, here - y);
  *slope = steep > R(0.0) ? steep : R(0.0);
  return y;
}

static void evaluate(const path *along, ANHYST_REAL x, answer *at)
{
  const anhyst_full_law_x *law = along->law;
  ANHYST_REAL x_slope;
  const ANHYST_REAL anhysteretic = curve(along, x, &x_slope);
  at->x = x;
  at->p = x - law->play > along->from.p ? x - law->play : along->from.p;
  at->y = irreversible(along, at->p, &at->y_slope);
  at->m = magnetisation(along, at->y, anhysteretic);
  at->m_slope = magnetisation(along, at->y_slope, x_slope);
}

/* Finds where the irreversible part departs, and the answer at the start. */
static void depart(path *along, answer *at)
{
  const anhyst_full_memory_x *from = &along->from;
  ANHYST_REAL slope;
  ANHYST_REAL x_slope;
  const ANHYST_REAL anhysteretic = curve(along, from->x, &x_slope);
  const ANHYST_REAL pull = curve(along, from->p, &slope);
  at->x = from->x;
  at->p = from->p;
  at->y = from->y;
  at->y_slope = R(0.0);
  const int goes_on = from->turn < from->p; /* on the way that began there */
  along->turn = goes_on ? from->turn : from->p;
  along->level = goes_on ? from->level : from->y;
  /* Held until the anhysteretic has crossed y. Where that is exactly hardly matters, since y leaves
     with slope zero. */
  const ANHYST_REAL crossing = inverse_curve(along->law, along->level);
  along->departure = crossing > along->turn ? crossing : along->turn;
  if (pull >= from->y && from->p + along->law->play - from->x <= along->short_way) {
    at->y_slope = pulled(along, pull - from->y); /* the play is taken up */
  }
  along->branch = branch(along, along->departure, &slope);
  at->m = magnetisation(along, at->y, anhysteretic);
  at->m_slope = magnetisation(along, at->y_slope, x_slope);
}

/* air*x + iron*m = target along a rising path, and the interval known to hold the solution. */
typedef struct {
  ANHYST_REAL air;
  ANHYST_REAL iron;
  ANHYST_REAL target;
  ANHYST_REAL low;
  ANHYST_REAL high;
  ANHYST_REAL residual; /* at the last place looked at */
} search;

/* Where the path would meet its target if m rose like the anhysteretic curve: a guess that holds
   over long ways, where a tangent does not. */
static ANHYST_REAL follow_curve(const path *along, const search *find, ANHYST_REAL x)
{
  ANHYST_REAL slope;
  const ANHYST_REAL start = curve(along, x, &slope);
  if (find->iron >= R(0.0)) {
    /* The air hardly counts; iron that does not count at all must not be divided by. */
    const ANHYST_REAL least = R(1e-6) * find->air;
    const ANHYST_REAL level = start - find->residual / (find->iron > least ? find->iron : least);
    return inverse_curve(along->law, anhyst_limited_x(level, R(-1.0), R(1.0)));
  }
  /* Iron that counts against the air: as far as the air alone would go, and on with what the iron
     has risen by then, which never goes too far. */
  ANHYST_REAL next = x - find->residual / find->air;
  for (uint16_t i = 1; i < CHORDS; i++) {
    const ANHYST_REAL risen = curve(along, next, &slope) - start;
    next = x - (find->residual + find->iron * risen) / find->air;
  }
  return next;
}

/* Looks at a place: narrows the interval, and gives where the tangent would meet the target. */
static ANHYST_REAL look(search *find, const answer *at)
{
  find->residual = find->air * at->x + find->iron * at->m - find->target;
  if (find->residual < R(0.0)) {
    find->low = at->x;
  } else {
    find->high = at->x;
  }
  const ANHYST_REAL slope = find->air + find->iron * at->m_slope;
  const ANHYST_REAL least = R(1e-6) * find->air;
  return at->x - find->residual / (slope > least ? slope : least);
}

/* Moves an answer along its tangents to x, a short way. */
static void slide(const path *along, ANHYST_REAL x, answer *at)
{
  const anhyst_full_memory_x *from = &along->from;
  const ANHYST_REAL way = x - at->x;
  at->x = x;
  at->y = anhyst_limited_x(at->y + way * at->y_slope, from->y, R(1.0));
  at->m += way * at->m_slope;
  if (at->p > from->p) {
    at->p = x - along->law->play > from->p ? x - along->law->play : from->p;
  }
}

/* Where to look first on a path that begins held, up to a known end: there m needs no evaluation
   and shows on which side the solution lies. The tangent at the start knows nothing of what comes
   after the end. */
static ANHYST_REAL leave_hold(const path *along, search *find, ANHYST_REAL end, ANHYST_REAL tangent)
{
  ANHYST_REAL slope;
  const ANHYST_REAL m = magnetisation(along, along->from.y, curve(along, end, &slope));
  ANHYST_REAL first = tangent;
  find->residual = find->air * end + find->iron * m - find->target;
  if (find->residual < R(0.0)) {
    find->low = end;
    first = follow_curve(along, find, end);
  } else {
    find->high = end;
  }
  return anhyst_limited_x(first, find->low, find->high);
}

/* Solves from *at, the start of the path, where the residual is negative. Newton's steps inside an
   interval that always holds the solution. A step must stay inside it and be shorter by a quarter
   than the last one, since tangents can swing to and fro across the two bends of the curve, or be
   too short to matter; any other follows the anhysteretic curve instead, or goes to the middle:
   with iron that counts against the air, where the curve leads a little way at a time if the sum is
   all but flat, as soon as the last step was longer than what is left of the interval. The number
   of evaluations is fixed; a last step is taken along
   the tangents, and what is left of the residual then is part of the accuracy budget. */
static void rise(const path *along, search *find, answer *at)
{
  const ANHYST_REAL reach = along->law->reach;
  const ANHYST_REAL moves = along->departure > along->from.p ? along->departure : along->from.p;
  const ANHYST_REAL freed = moves + along->law->play;
  ANHYST_REAL furthest = R(4.0) * reach;
  find->low = at->x;
  find->high = reach;
  for (uint16_t i = 0; i < along->law->iterations; i++) {
    const ANHYST_REAL x = at->x;
    ANHYST_REAL next = look(find, at);
    const ANHYST_REAL way = anhyst_size_x(next - x);
    const int inside = next > find->low && next < find->high;
    if (i == 0U && freed - x > along->short_way && freed < reach) {
      next = leave_hold(along, find, freed, next);
    } else if (way <= along->short_way || (inside && way <= R(0.75) * furthest)) {
      next = anhyst_limited_x(next, find->low, find->high);
      furthest = anhyst_size_x(next - x);
    } else {
      const ANHYST_REAL before = furthest;
      furthest = find->high - find->low;
      next = find->low;
      if (furthest > along->long_way && (find->iron >= R(0.0) || i < 2U || before < furthest)) {
        next = follow_curve(along, find, x);
      }
      if (!(next > find->low && next < find->high)) {
        next = find->low + R(0.5) * furthest;
      }
    }
    evaluate(along, next, at);
  }
  const ANHYST_REAL last = look(find, at);
  slide(along, anhyst_limited_x(last, find->low, find->high), at);
}

static anhyst_full_memory_x turned(anhyst_full_memory_x memory)
{
  memory.p = -memory.p;
  memory.y = -memory.y;
  memory.turn = -memory.turn;
  memory.level = -memory.level;
  memory.x = -memory.x;
  return memory;
}

/* Where an answer on a path leaves the iron. */
static anhyst_full_memory_x remember(const path *along, const answer *at)
{
  anhyst_full_memory_x memory = along->from;
  memory.x = at->x;
  memory.y = at->y;
  memory.p = at->p;
  if (at->p > along->from.p) { /* otherwise the play has not turned either */
    memory.turn = along->turn;
    memory.level = along->level;
  }
  return memory;
}

/* Solves air*x + iron*m = target from a memory; air > 0, and air + iron*dm/dx > 0 on any path.
   Returns m. */
static ANHYST_REAL meet(const anhyst_full_law_x *law, const anhyst_full_memory_x *from,
                        ANHYST_REAL air, ANHYST_REAL iron, ANHYST_REAL target,
                        anhyst_full_memory_x *to)
{
  ANHYST_REAL slope;
  path along;
  along.law = law;
  along.from = *from;
  along.scale = (ANHYST_REAL)law->curve_segments / law->reach;
  along.short_way = law->reach * R(0.00006103515625);
  along.long_way = law->reach * R(0.015625);
  const ANHYST_REAL m = magnetisation(&along, from->y, curve(&along, from->x, &slope));
  const ANHYST_REAL of_air = air * from->x;
  const ANHYST_REAL of_iron = iron * m;
  const ANHYST_REAL residual = of_air + of_iron - target;
  const ANHYST_REAL size = anhyst_size_x(of_air) + anhyst_size_x(of_iron) + anhyst_size_x(target);
  if (!(anhyst_size_x(residual) > anhyst_noise_x(size))) {
    *to = *from; /* there already, or the target is no number */
    return m;
  }
  const int falling = residual > R(0.0);
  answer at;
  search find;
  find.air = air;
  find.iron = iron;
  find.target = falling ? -target : target;
  if (falling) {
    along.from = turned(along.from);
  }
  depart(&along, &at);
  rise(&along, &find, &at);
  *to = remember(&along, &at);
  if (falling) {
    *to = turned(*to);
  }
  return falling ? -at.m : at.m;
}

static ANHYST_REAL full_field(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                              const ANHYST_REAL *plays, ANHYST_REAL flux, anhyst_memory_x *to)
{
  (void)plays;
  const anhyst_full_law_x *law = parameters->full;
  (void)meet(law, &from->full, law->air, R(1.0), flux, &to->full);
  return to->full.x;
}

/* With flux = m + h*x the current is (field_arm + flux_arm*h)*x + flux_arm*m. */
static ANHYST_REAL full_flux(const anhyst_parameters_x *parameters, const anhyst_memory_x *from,
                             const ANHYST_REAL *plays, const anhyst_at_gap_x *arms,
                             ANHYST_REAL current, anhyst_memory_x *to)
{
  (void)plays;
  const anhyst_full_law_x *law = parameters->full;
  const ANHYST_REAL air = arms->field_arm + arms->flux_arm * law->air;
  const ANHYST_REAL m =
      meet(law, &from->full, air, arms->flux_arm, current - arms->bias, &to->full);
  return m + law->air * to->full.x;
}

/* Whether more field needs more current at every gap. No path is steeper than the ascending branch
   and the anhysteretic curve together. */
static int current_rises(const anhyst_parameters_x *parameters)
{
  const anhyst_full_law_x *law = parameters->full;
  const ANHYST_REAL scale = (ANHYST_REAL)law->curve_segments / law->reach;
  ANHYST_REAL steepest = R(0.0);
  for (uint16_t i = 0; i < law->curve_segments; i++) {
    const ANHYST_REAL *rising = law->branch + law->curve_segments + i;
    const ANHYST_REAL irreversible = rising[1] - rising[0];
    const ANHYST_REAL anhysteretic = law->curve[i + 1U] - law->curve[i];
    const ANHYST_REAL slope =
        scale * (irreversible + law->reversible * (anhysteretic - irreversible));
    steepest = slope > steepest ? slope : steepest;
  }
  for (uint16_t i = 0; i <= parameters->gap_segments; i++) {
    const anhyst_at_gap_x *row = parameters->gaps + i;
    if (!(row->field_arm + row->flux_arm * (law->air + steepest) > R(0.0))) {
      return 0;
    }
  }
  return 1;
}

static int full_is_valid(const anhyst_parameters_x *parameters)
{
  const anhyst_full_law_x *law = parameters->full;
  const ANHYST_REAL largest = R(1e6);
  return law != 0 && law->curve != 0 && law->branch != 0 && law->inverse != 0 &&
         law->reach > R(0.0) && law->reach <= largest && law->air > R(0.0) && law->air <= largest &&
         law->reversible >= R(0.0) && law->reversible <= R(1.0) && law->play >= R(0.0) &&
         law->play <= largest && law->octaves > R(0.0) && law->octaves <= largest &&
         law->iterations >= 2U && law->iterations <= 16U && law->curve_segments >= 8U &&
         law->curve_segments <= 4096U && law->inverse_segments >= 8U &&
         law->inverse_segments <= 4096U &&
         anhyst_rises_x(law->curve, law->curve_segments, R(0.0), R(1.0)) &&
         anhyst_rises_x(law->branch, (uint16_t)(2U * law->curve_segments), R(-1.0), R(1.0)) &&
         anhyst_rises_x(law->inverse, law->inverse_segments, R(0.0), law->reach) &&
         current_rises(parameters);
}

static void full_carry(const anhyst_parameters_x *before, anhyst_memory_x *memory,
                       ANHYST_REAL *plays)
{
  (void)before;
  (void)plays;
  memory->full.turn = memory->full.p;
  memory->full.level = memory->full.y;
}

const anhyst_kernel_x anhyst_kernel_full_x = {full_field, full_flux, full_is_valid, full_carry, 0};
