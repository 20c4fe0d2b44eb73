/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/magnet.h"

#include <math.h>
#include <stddef.h>

#include "anhyst_plant/sensor.h"

/* Of the flux density, T: less than 1e-6 of the largest force of a magnet of 1 T and more. */
#define TOLERANCE 1e-7
#define ITERATIONS 100
#define CONE_TOLERANCE 1e-10 /* the same where a cone is, T */
#define SUBSTEPS 8           /* of a way that takes time */

typedef struct {
  double outer;    /* reluctance that the flux of the iron passes outside it, 1/H */
  double share;    /* of it that passes the gaps */
  double per_area; /* 1/(area of a gap, fringes included), 1/m^2 */
  double widens;   /* 1 - gap*(change of the area for each metre)/area */
  double moved;    /* of a bias: by so much from the middle towards the force, m */
  anhyst_plant_cone_gap cone;
} around;

/* What the ampere-turns over a cone count for in an equation of the iron. */
typedef struct {
  const anhyst_plant_cone_gap *at;
  double area;   /* of the iron, m^2 */
  double weight; /* of an ampere-turn in the equation */
  double over;   /* found last, A */
} over_cone;

/* Where a step ends. */
typedef struct {
  around around; /* the iron; circuit only */
  double gap;    /* m */
  double half;   /* of the step, s */
  double eddies; /* what they take of the current, A for each V that is induced */
  double begun;  /* flux linkage there, but for what the end itself adds, Wb */
} ending;

/* What is found there. */
typedef struct {
  anhyst_plant_goal goal;    /* of the iron; circuit only */
  anhyst_plant_soaked solid; /* of solid iron */
  double over;               /* ampere-turns over a cone, A */
  double steady;             /* current that the field needs, A */
  double current;            /* with that of the eddies, A */
} reached;

static inline void around_iron(const anhyst_plant_circuit *c, double gap, around *found)
{
  found->outer = c->joints;
  found->share = 1.0;
  found->per_area = 0.0; /* nothing reads it of a cone */
  found->widens = 1.0;
  found->moved = c->middle - gap;
  if (c->cone) {
    anhyst_plant_cone_at(c->cone, gap, &found->cone);
  } else if (c->bias == 0.0) {
    const double area = (c->pole_width + gap) * (c->pole_depth + gap);
    const double permeance = 0.5 * ANHYST_PLANT_MU0 * area / gap;
    const double outer = 1.0 / (permeance + c->leakage);
    const double per_area = 1.0 / area;
    found->share = permeance * outer;
    found->outer += outer;
    found->per_area = per_area;
    found->widens = 1.0 - gap * (c->pole_width + c->pole_depth + 2.0 * gap) * per_area;
  } else {
    found->per_area = 1.0 / c->iron_area;
  }
}

static inline void pull(const anhyst_plant_circuit *c, const around *at, anhyst_plant_coil *coil)
{
  const double flux = coil->iron.density * c->iron_area * at->share;
  if (c->cone) {
    double slope;
    coil->over = anhyst_plant_cone_mmf(&at->cone, flux, coil->over, &slope);
    coil->density = ANHYST_PLANT_MU0 * coil->over / at->cone.gap;
    coil->force = anhyst_plant_cone_force(&at->cone, coil->over);
    return;
  }
  coil->density = flux * at->per_area;
  coil->force = c->bias == 0.0 ? flux * coil->density * (1.0 / ANHYST_PLANT_MU0) * at->widens
                               : c->bias * flux - c->spring * at->moved;
}

static double needs_over_cone(void *self, double density, double *slope)
{
  over_cone *of = (over_cone *)self;
  of->over = anhyst_plant_cone_mmf(of->at, of->area * density, of->over, slope);
  *slope *= of->weight * of->area;
  return of->weight * of->over;
}

/* Field and flux density of the iron, for which a*H + b*B = r, to within a flux density; of a cone
   with its ampere-turns, so much for each. */
static inline void iron_answers(const anhyst_plant_circuit *c, const anhyst_plant_coil *coil,
                                const around *at, const anhyst_plant_asked *asked, double weight,
                                double tolerance, reached *found)
{
  found->over = 0.0;
  if (c->cone) {
    over_cone of = {&at->cone, c->iron_area, weight, coil->over};
    const anhyst_plant_beyond beyond = {needs_over_cone, &of};
    const double least = weight * c->iron_area / (at->cone.straight + at->cone.cone);
    anhyst_plant_field(&c->iron, &coil->iron, asked->a, asked->b, asked->r,
                       (asked->b + least) * CONE_TOLERANCE, &beyond, &found->goal);
    found->over = of.over;
    found->solid.field = found->goal.field;
    found->solid.density = found->goal.density;
  } else if (c->solid) {
    anhyst_plant_soak(&c->iron, c->solid, coil->volume, &coil->iron, asked, &found->solid);
  } else {
    anhyst_plant_field(&c->iron, &coil->iron, asked->a, asked->b, asked->r, tolerance, NULL,
                       &found->goal);
    found->solid.field = found->goal.field;
    found->solid.density = found->goal.density;
  }
}

static void iron_moves(const anhyst_plant_circuit *c, anhyst_plant_coil *coil, const reached *found)
{
  if (c->solid) {
    anhyst_plant_soaked_move(&c->iron, c->solid, coil->volume, &coil->iron, &found->solid);
  } else {
    anhyst_plant_move(&c->iron, &coil->iron, &found->goal);
  }
}

/* psi(current) at a gap, and its slope. */
static double linkage(const anhyst_plant_flux_table *t, double current, double gap, double *slope)
{
  const double row = anhyst_plant_bound((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0, 1.0) *
                     (double)(t->gaps - 1);
  const int above = row >= (double)(t->gaps - 1) ? t->gaps - 2 : (int)row;
  const double between = row - (double)above;
  const double step = t->current_high / (double)(t->currents - 1);
  const double place = fabs(current) / step;
  const int left = place >= (double)(t->currents - 1) ? t->currents - 2 : (int)place;
  const double *low = t->psi + (size_t)above * (size_t)t->currents + left;
  const double *high = low + t->currents;
  const double begin = low[0] + between * (high[0] - low[0]);
  const double end = low[1] + between * (high[1] - low[1]);
  *slope = (end - begin) / step;
  return copysign(begin + (place - (double)left) * (end - begin), current);
}

/* The current for which psi(current) + b*current = r. */
static double current_for(const anhyst_plant_flux_table *t, double gap, double b, double r,
                          double start)
{
  double current = start;
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  int i;
  for (i = 0; i < ITERATIONS; i++) {
    double slope;
    const double left = r - linkage(t, current, gap, &slope) - b * current;
    const double next = current + left / (slope + b);
    if (left > 0.0) {
      low = current;
    } else {
      high = current;
    }
    if (fabs(next - current) <= 1e-12 * t->current_high) {
      break;
    }
    current = next > low && next < high ? next : 0.5 * (low + high);
  }
  return current;
}

static anhyst_plant_row row_at(const anhyst_plant_law *law, double gap)
{
  const anhyst_plant_flux_table *t = &law->table;
  const double place =
      anhyst_plant_bound((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0, 1.0) *
      (double)(law->row_count - 1);
  const int below = place >= (double)(law->row_count - 1) ? law->row_count - 2 : (int)place;
  const double share = place - (double)below;
  const anhyst_plant_row *a = law->rows + below;
  const anhyst_plant_row *b = a + 1;
  anhyst_plant_row found;
  found.drive = a->drive + share * (b->drive - a->drive);
  found.gap_ratio = a->gap_ratio + share * (b->gap_ratio - a->gap_ratio);
  found.gain = a->gain + share * (b->gain - a->gain);
  found.offset = a->offset + share * (b->offset - a->offset);
  found.zero = a->zero + share * (b->zero - a->zero);
  found.density = a->density + share * (b->density - a->density);
  return found;
}

/* Takes the law to a current; where it has no solution its state stays. The eddy currents follow
   the flux density by the backward formula of second order, which rings at no step. */
static void law_moves(const anhyst_plant_law *law, anhyst_plant_coil *coil, double gap,
                      double per_second)
{
  const anhyst_plant_row row = row_at(law, gap);
  const double before = anhyst_flux_of_f64(law->iron, &coil->law);
  const double opposing = law->eddy * per_second;
  anhyst_circuit_f64 circuit;
  double flux;
  circuit.gap_ratio = row.gap_ratio;
  circuit.eddy = 1.5 * opposing;
  (void)anhyst_commit_f64(law->iron, &coil->law, &circuit,
                          row.drive * (coil->current - row.zero) + 0.5 * opposing * coil->stride);
  flux = anhyst_flux_of_f64(law->iron, &coil->law);
  coil->stride = flux - before;
  coil->density = row.density * flux;
  coil->force = row.gain * flux * flux + row.offset;
}

/* What the eddy currents take of the winding's current, A for each V that is induced in it. */
static double eddy_share(const anhyst_plant_magnet *magnet)
{
  const anhyst_plant_circuit *c = magnet->circuit;
  return c && c->eddy > 0.0
             ? c->eddy * c->iron_length / (magnet->turns * magnet->turns * c->iron_area)
             : 0.0;
}

/* Current that flows where the field alone needs so much of it; without eddies exactly that. */
static inline double current_under(const anhyst_plant_magnet *magnet, double eddies, double steady,
                                   const anhyst_plant_source *s)
{
  return eddies > 0.0 ? (steady + eddies * (s->gain * s->reference + s->voltage)) /
                            (1.0 + eddies * (s->gain + magnet->resistance))
                      : steady;
}

/* Where its voltage is beyond the limit, makes of a source one that gives the limit; returns
   whether it did. The current then lies even farther from the reference, where the limit holds. */
static inline int limited(anhyst_plant_source *s, double current)
{
  const double voltage = s->gain * (s->reference - current) + s->voltage;
  if (fabs(voltage) <= s->limit) {
    return 0;
  }
  s->gain = 0.0;
  s->voltage = copysign(s->limit, voltage);
  return 1;
}

/* Takes iron and current to the end of a step of twice so many seconds. The flux linkage there is
   begun, plus what the end adds. */
static inline void end_under(const anhyst_plant_magnet *magnet, const anhyst_plant_coil *coil,
                             const anhyst_plant_source *s, const ending *end, reached *found)
{
  const double given = s->gain * s->reference + s->voltage;
  const double taken = s->gain + magnet->resistance;
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    const double half = end->eddies > 0.0 ? end->half / (1.0 + end->eddies * taken) : end->half;
    const double per_field = c->iron_length / magnet->turns;
    const double per_density = end->around.outer * c->iron_area / magnet->turns;
    const double weight = magnet->turns * c->iron_area;
    const double moved = c->bias == 0.0 ? 0.0 : c->bias * end->around.moved / magnet->turns;
    const anhyst_plant_asked asked = {half * taken * per_field, weight + half * taken * per_density,
                                      end->begun + half * (given + taken * moved), 0.5 / end->half};
    iron_answers(c, coil, &end->around, &asked, half * taken / magnet->turns, weight * TOLERANCE,
                 found);
    found->steady = per_field * found->solid.field + per_density * found->solid.density - moved;
    if (c->cone) {
      found->steady += found->over / magnet->turns;
    }
  } else {
    found->steady = current_for(&magnet->law->table, end->gap, end->half * taken,
                                end->begun + end->half * given, coil->steady);
  }
  found->current = current_under(magnet, end->eddies, found->steady, s);
}

static inline void iron_follows(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                                const ending *end, const reached *found)
{
  if (magnet->circuit) {
    iron_moves(magnet->circuit, coil, found);
    pull(magnet->circuit, &end->around, coil);
  } else {
    law_moves(magnet->law, coil, end->gap, 0.5 / end->half);
  }
}

void anhyst_plant_coil_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            const anhyst_plant_source *source, double gap, double seconds)
{
  const double half = 0.5 * seconds;
  anhyst_plant_source s = *source;
  ending end;
  reached found;
  double before;
  double voltage;
  int beyond;
  end.gap = gap;
  end.half = half;
  end.eddies = eddy_share(magnet);
  s.voltage += coil->integral;
  before = current_under(magnet, end.eddies, coil->steady, &s);
  beyond = limited(&s, before);
  if (beyond) {
    before = current_under(magnet, end.eddies, coil->steady, &s);
  }
  voltage = s.gain * (s.reference - before) + s.voltage;
  end.begun = coil->psi + half * (voltage - magnet->resistance * before);
  coil->heat += half * magnet->resistance * before * before;
  coil->energy += half * voltage * before;

  if (magnet->circuit) {
    around_iron(magnet->circuit, gap, &end.around);
  }
  s = *source;
  s.gain += half * s.reset;
  s.voltage += coil->integral + half * s.reset * (s.reference - before);
  end_under(magnet, coil, &s, &end, &found);
  if (limited(&s, found.current)) {
    beyond = 1;
    end_under(magnet, coil, &s, &end, &found);
  }
  voltage = s.gain * (s.reference - found.current) + s.voltage;
  coil->psi = end.begun + half * (voltage - magnet->resistance * found.current);
  coil->heat += half * magnet->resistance * found.current * found.current;
  coil->energy += half * voltage * found.current;
  coil->steady = found.steady;
  coil->current = found.current;
  coil->voltage = voltage;
  if (!beyond) {
    coil->integral += half * source->reset * (2.0 * source->reference - before - found.current);
  }
  iron_follows(magnet, coil, &end, &found);
}

void anhyst_plant_coil_lead(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            double current, double gap, double per_second)
{
  coil->steady = current;
  coil->current = current;
  coil->voltage = magnet->resistance * current;
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    around at;
    around_iron(c, gap, &at);
    const double b = at.outer * c->iron_area;
    const double opposing = c->eddy * c->iron_length * per_second;
    const double before = coil->iron.density;
    const anhyst_plant_asked asked = {
        c->iron_length, b + opposing,
        magnet->turns * current + c->bias * at.moved + opposing * before, per_second};
    reached found;
    iron_answers(c, coil, &at, &asked, 1.0, b * TOLERANCE, &found);
    iron_moves(c, coil, &found);
    coil->steady -= opposing / magnet->turns * (coil->iron.density - before);
    pull(c, &at, coil);
    coil->psi = magnet->turns * c->iron_area * coil->iron.density;
  } else {
    double slope;
    law_moves(magnet->law, coil, gap, per_second);
    coil->psi = linkage(&magnet->law->table, current, gap, &slope);
  }
}

void anhyst_plant_coil_follow(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                              double current, double gap, double seconds)
{
  const double start = coil->current;
  const double step = (current - start) / SUBSTEPS;
  const double per_second = 1.0 / (seconds / SUBSTEPS);
  int n;
  for (n = 1; n < SUBSTEPS; n++) {
    anhyst_plant_coil_lead(magnet, coil, start + n * step, gap, per_second);
  }
  anhyst_plant_coil_lead(magnet, coil, current, gap, per_second);
}
