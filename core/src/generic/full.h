/* SPDX-License-Identifier: Apache-2.0 */

/* A rising path, prepared for evaluation at many places. */
typedef struct {
  const ANHYST_NAME(anhyst_full_law) *law;
  ANHYST_NAME(anhyst_memory) from;
  ANHYST_REAL departure; /* of the irreversible part */
  ANHYST_REAL level;     /* irreversible part there */
  ANHYST_REAL branch;    /* A there */
} ANHYST_NAME(path);

/* What the law answers at one place of it. */
typedef struct {
  ANHYST_REAL x;
  ANHYST_REAL y;
  ANHYST_REAL p;
  ANHYST_REAL m;
  ANHYST_REAL m_slope; /* dm/dx */
} ANHYST_NAME(answer);

/* L(x) and its slope. */
static ANHYST_REAL ANHYST_NAME(curve)(const ANHYST_NAME(anhyst_full_law) *law, ANHYST_REAL x,
                                      ANHYST_REAL *slope)
{
  const ANHYST_REAL scale = (ANHYST_REAL)law->curve_segments / law->reach;
  const ANHYST_NAME(anhyst_spot) spot =
      ANHYST_NAME(anhyst_spot_of)(law->curve_segments, ANHYST_NAME(anhyst_size)(x) * scale);
  const ANHYST_REAL value = ANHYST_NAME(anhyst_value_at)(law->curve, spot);
  *slope = ANHYST_NAME(anhyst_rise_at)(law->curve, spot) * scale;
  return x < R(0.0) ? -value : value;
}

/* A(x) and its slope. */
static ANHYST_REAL ANHYST_NAME(branch)(const ANHYST_NAME(anhyst_full_law) *law, ANHYST_REAL x,
                                       ANHYST_REAL *slope)
{
  const ANHYST_REAL scale = (ANHYST_REAL)law->curve_segments / law->reach;
  const ANHYST_NAME(anhyst_spot) spot =
      ANHYST_NAME(anhyst_spot_of)((uint16_t)(2U * law->curve_segments), (x + law->reach) * scale);
  *slope = ANHYST_NAME(anhyst_rise_at)(law->branch, spot) * scale;
  return ANHYST_NAME(anhyst_value_at)(law->branch, spot);
}

/* The field at which L reaches y. */
static ANHYST_REAL ANHYST_NAME(inverse_curve)(const ANHYST_NAME(anhyst_full_law) *law,
                                              ANHYST_REAL y)
{
  const ANHYST_NAME(anhyst_spot) spot = ANHYST_NAME(anhyst_spot_of)(
      law->inverse_segments, ANHYST_NAME(anhyst_size)(y) * (ANHYST_REAL)law->inverse_segments);
  const ANHYST_REAL value = ANHYST_NAME(anhyst_value_at)(law->inverse, spot);
  return y < R(0.0) ? -value : value;
}

/* 1 - 2^(-t) for a way of t octaves, t >= 0. Below one octave a polynomial for (1 - 2^-f)/f, whole
   octaves by an exact power of two. Error below 1e-9 before rounding, relative to t where t is
   small. */
static ANHYST_REAL ANHYST_NAME(forgotten)(ANHYST_REAL t)
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

static ANHYST_REAL ANHYST_NAME(magnetisation)(const ANHYST_NAME(anhyst_full_law) *law,
                                              ANHYST_REAL y, ANHYST_REAL anhysteretic)
{
  return y + law->reversible * (anhysteretic - y);
}

static void ANHYST_NAME(depart)(ANHYST_NAME(path) *along, const ANHYST_NAME(anhyst_full_law) *law,
                                const ANHYST_NAME(anhyst_memory) *from)
{
  ANHYST_REAL slope;
  along->law = law;
  along->from = *from;
  if (from->turn < from->place) { /* still on the way on which it set out there */
    along->departure = from->turn;
    along->level = from->turn_level;
  } else {
    along->departure = from->place;
    along->level = from->level;
    if (ANHYST_NAME(curve)(law, from->place, &slope) < from->level) {
      /* Held until the anhysteretic has crossed y; what b is exactly hardly matters, since y
         leaves with slope zero. */
      const ANHYST_REAL crossing = ANHYST_NAME(inverse_curve)(law, from->level);
      along->departure = crossing > from->place ? crossing : from->place;
    }
  }
  along->branch = ANHYST_NAME(branch)(law, along->departure, &slope);
}

/* The irreversible part where the play stands at p; *slope is dy/dp. */
static ANHYST_REAL ANHYST_NAME(irreversible)(const ANHYST_NAME(path) *along, ANHYST_REAL p,
                                             ANHYST_REAL *slope)
{
  const ANHYST_NAME(anhyst_full_law) *law = along->law;
  *slope = R(0.0);
  if (p <= along->departure) {
    return along->from.level;
  }
  ANHYST_REAL rise;
  const ANHYST_REAL here = ANHYST_NAME(branch)(law, p, &rise);
  const ANHYST_REAL lost = ANHYST_NAME(forgotten)((p - along->departure) * law->octaves);
  const ANHYST_REAL risen = (along->branch - along->level) * lost + (here - along->branch);
  const ANHYST_REAL y =
      ANHYST_NAME(anhyst_limited)(along->level + risen, along->from.level, R(1.0));
  const ANHYST_REAL steep = rise + (here - y) / law->kappa;
  *slope = steep > R(0.0) ? steep : R(0.0);
  return y;
}

static void ANHYST_NAME(evaluate)(const ANHYST_NAME(path) *along, ANHYST_REAL x,
                                  ANHYST_NAME(answer) *at)
{
  const ANHYST_NAME(anhyst_full_law) *law = along->law;
  ANHYST_REAL x_slope;
  ANHYST_REAL y_slope;
  const ANHYST_REAL anhysteretic = ANHYST_NAME(curve)(law, x, &x_slope);
  at->x = x;
  at->p = x - law->play > along->from.place ? x - law->play : along->from.place;
  at->y = ANHYST_NAME(irreversible)(along, at->p, &y_slope);
  at->m = ANHYST_NAME(magnetisation)(law, at->y, anhysteretic);
  at->m_slope = y_slope + law->reversible * (x_slope - y_slope);
}

/* Where the path would meet its target if m rose like the anhysteretic curve: a guess that holds
   over long ways, where a tangent does not. residual is that at x. */
static ANHYST_REAL ANHYST_NAME(follow_curve)(const ANHYST_NAME(anhyst_full_law) *law, ANHYST_REAL x,
                                             ANHYST_REAL iron, ANHYST_REAL residual)
{
  ANHYST_REAL slope;
  const ANHYST_REAL level = ANHYST_NAME(curve)(law, x, &slope) - residual / iron;
  return ANHYST_NAME(inverse_curve)(law, ANHYST_NAME(anhyst_limited)(level, R(-1.0), R(1.0)));
}

/* Solves air*x + iron*m = target along a rising path on which the residual begins below zero.
   Newton's steps inside an interval that always holds the solution. A step must stay inside it and
   be shorter by a quarter than the last one, since tangents can swing to and fro across the two
   bends of the curve, or be too short to matter; any other follows the anhysteretic curve instead,
   or goes to the middle. The number of evaluations is fixed; what is left of the residual after
   them is part of the accuracy budget. */
static void ANHYST_NAME(rise)(const ANHYST_NAME(path) *along, ANHYST_REAL air, ANHYST_REAL iron,
                              ANHYST_REAL target, ANHYST_NAME(answer) *at)
{
  const ANHYST_REAL long_way = along->law->reach / R(64.0);
  const ANHYST_REAL short_way = along->law->reach / R(16384.0);
  /* Iron that does not count at all must not be divided by. */
  const ANHYST_REAL counted = iron > R(1e-6) * air ? iron : R(1e-6) * air;
  ANHYST_REAL low = along->from.x;
  ANHYST_REAL high = along->law->reach;
  ANHYST_REAL furthest = R(4.0) * high;
  ANHYST_REAL x = low;
  for (uint16_t i = 0; i < along->law->iterations; i++) {
    ANHYST_NAME(evaluate)(along, x, at);
    const ANHYST_REAL residual = air * x + iron * at->m - target;
    ANHYST_REAL next = x - residual / (air + iron * at->m_slope);
    const ANHYST_REAL way = ANHYST_NAME(anhyst_size)(next - x);
    if (residual < R(0.0)) {
      low = x;
    } else {
      high = x;
    }
    if (way <= short_way || (next > low && next < high && way <= R(0.75) * furthest)) {
      next = ANHYST_NAME(anhyst_limited)(next, low, high);
      furthest = ANHYST_NAME(anhyst_size)(next - x);
    } else {
      next = low;
      if (high - low > long_way) {
        next = ANHYST_NAME(follow_curve)(along->law, x, counted, residual);
      }
      if (!(next > low && next < high)) {
        next = low + R(0.5) * (high - low);
      }
      furthest = high - low;
    }
    x = next;
  }
  ANHYST_NAME(evaluate)(along, x, at);
}

static ANHYST_NAME(anhyst_memory)
    ANHYST_NAME(full_mirrored)(const ANHYST_NAME(anhyst_memory) *memory)
{
  ANHYST_NAME(anhyst_memory) other;
  other.place = -memory->place;
  other.level = -memory->level;
  other.turn = -memory->turn;
  other.turn_level = -memory->turn_level;
  other.x = -memory->x;
  return other;
}

/* Where an answer on a path leaves the iron. */
static void ANHYST_NAME(remember)(const ANHYST_NAME(path) *along, const ANHYST_NAME(answer) *at,
                                  ANHYST_NAME(anhyst_memory) *to)
{
  *to = along->from;
  to->x = at->x;
  to->level = at->y;
  to->place = at->p;
  if (at->p > along->departure) {
    to->turn = along->departure;
    to->turn_level = along->level;
  } else if (at->p > along->from.place) { /* held: what comes sets out from here */
    to->turn = at->p;
    to->turn_level = at->y;
  }
}

/* Solves air*x + iron*m = target from a memory; air > 0, iron >= 0. Returns m. */
static ANHYST_REAL ANHYST_NAME(meet)(const ANHYST_NAME(anhyst_full_law) *law,
                                     const ANHYST_NAME(anhyst_memory) *from, ANHYST_REAL air,
                                     ANHYST_REAL iron, ANHYST_REAL target,
                                     ANHYST_NAME(anhyst_memory) *to)
{
  ANHYST_REAL slope;
  const ANHYST_REAL m =
      ANHYST_NAME(magnetisation)(law, from->level, ANHYST_NAME(curve)(law, from->x, &slope));
  const ANHYST_REAL residual = air * from->x + iron * m - target;
  const ANHYST_REAL size = ANHYST_NAME(anhyst_size)(air * from->x) +
                           ANHYST_NAME(anhyst_size)(iron * m) + ANHYST_NAME(anhyst_size)(target);
  if (!(ANHYST_NAME(anhyst_size)(residual) > ANHYST_NAME(anhyst_noise)(size))) {
    *to = *from; /* there already, or the target is no number */
    return m;
  }
  ANHYST_NAME(path) along;
  ANHYST_NAME(answer) at;
  if (residual < R(0.0)) {
    ANHYST_NAME(depart)(&along, law, from);
    ANHYST_NAME(rise)(&along, air, iron, target, &at);
    ANHYST_NAME(remember)(&along, &at, to);
    return at.m;
  }
  const ANHYST_NAME(anhyst_memory) start = ANHYST_NAME(full_mirrored)(from);
  ANHYST_NAME(anhyst_memory) end;
  ANHYST_NAME(depart)(&along, law, &start);
  ANHYST_NAME(rise)(&along, air, iron, -target, &at);
  ANHYST_NAME(remember)(&along, &at, &end);
  *to = ANHYST_NAME(full_mirrored)(&end);
  return -at.m;
}

static ANHYST_REAL ANHYST_NAME(full_field)(const ANHYST_NAME(anhyst_parameters) *parameters,
                                           const ANHYST_NAME(anhyst_memory) *from, ANHYST_REAL flux,
                                           ANHYST_NAME(anhyst_memory) *to)
{
  const ANHYST_NAME(anhyst_full_law) *law = parameters->full;
  (void)ANHYST_NAME(meet)(law, from, law->air, R(1.0), flux, to);
  return to->x;
}

/* With flux = m + h*x the current is (field_arm + flux_arm*h)*x + flux_arm*m. */
static ANHYST_REAL ANHYST_NAME(full_flux)(const ANHYST_NAME(anhyst_parameters) *parameters,
                                          const ANHYST_NAME(anhyst_memory) *from,
                                          const ANHYST_NAME(anhyst_at_gap) *arms,
                                          ANHYST_REAL current, ANHYST_NAME(anhyst_memory) *to)
{
  const ANHYST_NAME(anhyst_full_law) *law = parameters->full;
  const ANHYST_REAL air = arms->field_arm + arms->flux_arm * law->air;
  const ANHYST_REAL m = ANHYST_NAME(meet)(law, from, air, arms->flux_arm, current - arms->bias, to);
  return m + law->air * to->x;
}

static int ANHYST_NAME(full_sound)(const ANHYST_NAME(anhyst_parameters) *parameters)
{
  const ANHYST_NAME(anhyst_full_law) *law = parameters->full;
  const ANHYST_REAL largest = R(1e6);
  return law != 0 && law->curve != 0 && law->branch != 0 && law->inverse != 0 &&
         law->reach > R(0.0) && law->reach <= largest && law->air > R(0.0) && law->air <= largest &&
         law->reversible >= R(0.0) && law->reversible <= R(1.0) && law->play >= R(0.0) &&
         law->play <= largest && law->kappa >= R(1.0) / largest && law->kappa <= largest &&
         law->octaves > R(0.0) && law->octaves <= R(2.0) * largest && law->iterations >= 2U &&
         law->iterations <= 16U && law->curve_segments >= 8U && law->curve_segments <= 4096U &&
         law->inverse_segments >= 8U && law->inverse_segments <= 4096U &&
         ANHYST_NAME(anhyst_rises)(law->curve, law->curve_segments, R(0.0), R(1.0)) &&
         ANHYST_NAME(anhyst_rises)(law->branch, (uint16_t)(2U * law->curve_segments), R(-1.0),
                                   R(1.0)) &&
         ANHYST_NAME(anhyst_rises)(law->inverse, law->inverse_segments, R(0.0), law->reach);
}

const ANHYST_NAME(anhyst_kernel) ANHYST_NAME(anhyst_kernel_full) = {
    ANHYST_NAME(full_field), ANHYST_NAME(full_flux), ANHYST_NAME(full_sound)};
