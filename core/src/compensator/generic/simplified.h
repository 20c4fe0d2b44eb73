/* SPDX-License-Identifier: Apache-2.0 */
/* The law with a straight anhysteretic curve in its closed form, in floating point: exact for a
   step of any size. Reduced to one state u in -1..1 that follows the flux; in the direction of
   travel, with p = u and v = 1 - p,

     dp/dflux = hold = rate/(1-nu)          while p < 0
     dp/dflux = rate*v/(1 - nu*v)           after that

   so that z = -ln v + nu*v - nu, the distance from p = 0, grows in proportion to the flux. A table
   over z gives p back; its segments double from octave to octave, since the curve is sharp at z = 0
   and flat far out. */

/* p over z, z >= 0. */
static ANHYST_REAL p_of(const anhyst_simplified_law_x *law, ANHYST_REAL z)
{
  const uint16_t end = (uint16_t)((law->octaves + 1U) * law->segments);
  ANHYST_REAL place = z / law->first; /* from 1 on in octaves */
  uint16_t before = 0;
  if (place >= (ANHYST_REAL)((uint32_t)1 << law->octaves)) {
    return law->curve[end];
  }
  if (place >= R(1.0)) {
    uint16_t octave = 0;
    if (place >= R(256.0)) {
      place *= R(0.00390625);
      octave = 8;
    }
    if (place >= R(16.0)) {
      place *= R(0.0625);
      octave = (uint16_t)(octave + 4U);
    }
    if (place >= R(4.0)) {
      place *= R(0.25);
      octave = (uint16_t)(octave + 2U);
    }
    if (place >= R(2.0)) {
      place *= R(0.5);
      octave = (uint16_t)(octave + 1U);
    }
    place -= R(1.0);
    before = (uint16_t)((octave + 1U) * law->segments);
  }
  const anhyst_spot_x spot = anhyst_spot_of_x(law->segments, place * (ANHYST_REAL)law->segments);
  return anhyst_value_at_x(law->curve + before, spot);
}

/* z over p, 0 <= p <= 1: the same table searched, so that there and back agree. */
static ANHYST_REAL z_of(const anhyst_simplified_law_x *law, ANHYST_REAL p)
{
  const uint16_t end = (uint16_t)((law->octaves + 1U) * law->segments);
  uint16_t index = 0;
  for (uint16_t step = (uint16_t)(8U * law->segments); step > 0U; step = (uint16_t)(step >> 1)) {
    if (index + step < end && law->curve[index + step] <= p) {
      index = (uint16_t)(index + step);
    }
  }
  const ANHYST_REAL rise = law->curve[index + 1U] - law->curve[index];
  const ANHYST_REAL over = p - law->curve[index];
  const ANHYST_REAL part = rise > R(0.0) ? anhyst_limited_x(over / rise, R(0.0), R(1.0)) : R(0.0);
  const uint16_t octave = (uint16_t)(index / law->segments); /* 0: below the first */
  const uint16_t inside = (uint16_t)(index % law->segments);
  const ANHYST_REAL place = ((ANHYST_REAL)inside + part) / (ANHYST_REAL)law->segments;
  if (octave == 0U) {
    return place * law->first;
  }
  return (R(1.0) + place) * (law->first * (ANHYST_REAL)((uint32_t)1 << (octave - 1U)));
}

/* On a rising path, the state where it is at the given flux, not below that of the start. */
static void advance(const anhyst_simplified_law_x *law, const anhyst_simplified_memory_x *start,
                    ANHYST_REAL flux, anhyst_simplified_memory_x *to)
{
  const ANHYST_REAL way = flux - start->turn;
  const ANHYST_REAL held = start->level + law->hold * way;
  ANHYST_REAL p;
  if (held < R(0.0)) {
    p = held;
  } else {
    /* What of the way went on while held counts for less. */
    const ANHYST_REAL before = start->level < R(0.0) ? start->level * (R(1.0) - law->nu) : start->z;
    const ANHYST_REAL z = law->rate * way + before;
    p = p_of(law, z > R(0.0) ? z : R(0.0));
  }
  *to = *start;
  to->flux = flux;
  to->u = p > start->u ? p : start->u;
}

/* A memory as the start of a rising path: what set out the other way sets out again. */
static anhyst_simplified_memory_x set_out(const anhyst_simplified_law_x *law,
                                          anhyst_simplified_memory_x from)
{
  if (!(from.turn < from.flux)) {
    from.turn = from.flux;
    from.level = from.u;
    from.z = from.u > R(0.0) ? z_of(law, from.u) : R(0.0);
  }
  return from;
}

/* The other way round if it falls: z counts in the direction of travel, whichever that is. */
static anhyst_simplified_memory_x facing(anhyst_simplified_memory_x memory, int falling)
{
  if (falling) {
    memory.flux = -memory.flux;
    memory.u = -memory.u;
    memory.turn = -memory.turn;
    memory.level = -memory.level;
  }
  return memory;
}

static ANHYST_REAL simplified_field(const anhyst_parameters_x *parameters,
                                    const anhyst_memory_x *from, const ANHYST_REAL *plays,
                                    ANHYST_REAL flux, anhyst_memory_x *to)
{
  (void)plays;
  const anhyst_simplified_law_x *law = parameters->simplified;
  const anhyst_simplified_memory_x *now = &from->simplified;
  const int falling = flux < now->flux;
  if (falling || flux > now->flux) {
    const anhyst_simplified_memory_x start = set_out(law, facing(*now, falling));
    anhyst_simplified_memory_x end;
    advance(law, &start, falling ? -flux : flux, &end);
    to->simplified = facing(end, falling);
  } else {
    to->simplified = *now;
  }
  return to->simplified.u;
}

/* dp/dflux on a rising path. */
static ANHYST_REAL lag_slope(const anhyst_simplified_law_x *law, ANHYST_REAL p)
{
  const ANHYST_REAL v = R(1.0) - p;
  return p < R(0.0) ? law->hold : law->rate * v / (R(1.0) - law->nu * v);
}

/* flux_arm*flux + field_arm*u = target on a rising path. In the direction of travel the sum is a
   concave function of the flux, so Newton's steps from the start come nearer without ever passing
   the solution. */
static void reach(const anhyst_simplified_law_x *law, const anhyst_simplified_memory_x *start,
                  const anhyst_at_gap_x *arms, ANHYST_REAL target, anhyst_simplified_memory_x *to)
{
  *to = *start;
  for (uint16_t i = 0; i < law->iterations; i++) {
    const ANHYST_REAL missing = target - arms->flux_arm * to->flux - arms->field_arm * to->u;
    const ANHYST_REAL slope = arms->flux_arm + arms->field_arm * lag_slope(law, to->u);
    if (missing <= R(0.0) || slope <= R(0.0)) {
      continue; /* as near as the numbers allow; the remaining rounds change nothing */
    }
    const ANHYST_REAL flux = to->flux + missing / slope;
    advance(law, start, flux < R(1.0) ? flux : R(1.0), to);
  }
}

static ANHYST_REAL simplified_flux(const anhyst_parameters_x *parameters,
                                   const anhyst_memory_x *from, const ANHYST_REAL *plays,
                                   const anhyst_at_gap_x *arms, ANHYST_REAL current,
                                   anhyst_memory_x *to)
{
  (void)plays;
  const anhyst_simplified_law_x *law = parameters->simplified;
  const anhyst_simplified_memory_x *now = &from->simplified;
  const ANHYST_REAL target = current - arms->bias;
  const ANHYST_REAL of_flux = arms->flux_arm * now->flux;
  const ANHYST_REAL of_state = arms->field_arm * now->u;
  const ANHYST_REAL missing = target - of_flux - of_state;
  const ANHYST_REAL size = anhyst_size_x(target) + anhyst_size_x(of_flux) + anhyst_size_x(of_state);
  if (!(anhyst_size_x(missing) > anhyst_noise_x(size))) {
    to->simplified = *now; /* there already, or the current is no number */
  } else {
    const int falling = missing < R(0.0);
    const anhyst_simplified_memory_x start = set_out(law, facing(*now, falling));
    anhyst_simplified_memory_x end;
    reach(law, &start, arms, falling ? -target : target, &end);
    to->simplified = facing(end, falling);
  }
  return to->simplified.flux;
}

/* Whether more flux needs no less current at any gap. */
static int flux_arm_is_valid(const anhyst_parameters_x *parameters)
{
  for (uint16_t i = 0; i <= parameters->gap_segments; i++) {
    if (!(parameters->gaps[i].flux_arm >= R(0.0))) {
      return 0;
    }
  }
  return 1;
}

static int simplified_is_valid(const anhyst_parameters_x *parameters)
{
  const anhyst_simplified_law_x *law = parameters->simplified;
  const ANHYST_REAL largest = R(1e6);
  return law != 0 && parameters->flux_limit <= R(1.0) && law->curve != 0 && law->rate > R(0.0) &&
         law->rate <= largest && law->hold > R(0.0) && law->hold <= largest && law->nu >= R(0.0) &&
         law->nu < R(1.0) && law->first > R(0.0) && law->first <= largest &&
         law->iterations >= 2U && law->iterations <= 16U && law->octaves >= 4U &&
         law->octaves <= 15U && law->segments >= 4U && law->segments <= 64U &&
         (law->segments & (law->segments - 1U)) == 0U &&
         anhyst_rises_x(law->curve, (uint16_t)((law->octaves + 1U) * law->segments), R(0.0),
                        R(1.0)) &&
         flux_arm_is_valid(parameters);
}

static void simplified_carry(const anhyst_parameters_x *before, anhyst_memory_x *memory,
                             ANHYST_REAL *plays)
{
  (void)before;
  (void)plays;
  memory->simplified.turn = memory->simplified.flux;
  memory->simplified.level = memory->simplified.u;
}

const anhyst_kernel_x anhyst_kernel_simplified_x = {simplified_field, simplified_flux,
                                                    simplified_is_valid, simplified_carry, 0};
