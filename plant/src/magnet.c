/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/magnet.h"

#include <math.h>
#include <stddef.h>

#include "anhyst_plant/sensor.h"

/* Flux density error, T: less than 1e-6 of the maximum force of a magnet of at least 1 T. */
#define FLUX_DENSITY_TOLERANCE 1e-7
#define MAX_ITERATIONS 100
#define CONE_TOLERANCE 1e-10 /* maximum error of the flux density with a cone, T */
#define MOVEMENT_STEPS 8     /* number of steps of a movement with a duration */

typedef struct {
  double outer;           /* reluctance in series with the iron, 1/H */
  double share;           /* fraction of the flux that crosses the gaps */
  double per_area;        /* 1/(area of a gap including fringing), 1/m^2 */
  double fringing_factor; /* 1 - gap*(derivative of the area per metre)/area */
  double displacement;    /* only with a bias: displacement from the middle along the force, m */
  anhyst_plant_cone_gap cone;
} outer_circuit;

/* The ampere-turns across a cone, as a term in the equation of the iron. */
typedef struct {
  const anhyst_plant_cone_gap *at;
  double area;   /* cross-section of the iron, m^2 */
  double weight; /* coefficient of the ampere-turns in the equation */
  double mmf;    /* last solved ampere-turns, A */
} cone_term;

typedef struct {
  outer_circuit outer; /* reluctances around the iron; circuit only */
  double gap;          /* m */
  double half;         /* half the step, s */
  double eddies;       /* coefficient of the eddy currents: current per induced voltage, A/V */
  double psi_start;    /* flux linkage without the terms at the end of the step, Wb */
} step_end;

typedef struct {
  anhyst_plant_goal goal;    /* goal of laminated iron; circuit only */
  anhyst_plant_soaked solid; /* result of solid iron */
  double mmf;                /* ampere-turns across a cone, A */
  double steady;             /* current without that of the eddy currents, A */
  double current;            /* total current including the eddy currents, A */
} solution;

static inline void find_circuit(const anhyst_plant_circuit *c, double gap, outer_circuit *found)
{
  found->outer = c->joints;
  found->share = 1.0;
  found->per_area = 0.0; /* zero, because a cone does not use it */
  found->fringing_factor = 1.0;
  found->displacement = c->middle - gap;
  if (c->cone) {
    anhyst_plant_evaluate_cone(c->cone, gap, &found->cone);
  } else if (c->bias == 0.0) {
    const double area = (c->pole_width + gap) * (c->pole_depth + gap);
    const double permeance = 0.5 * ANHYST_PLANT_MU0 * area / gap;
    const double outer = 1.0 / (permeance + c->leakage);
    const double per_area = 1.0 / area;
    found->share = permeance * outer;
    found->outer += outer;
    found->per_area = per_area;
    found->fringing_factor = 1.0 - gap * (c->pole_width + c->pole_depth + 2.0 * gap) * per_area;
  } else {
    found->per_area = 1.0 / c->iron_area;
  }
}

static inline void update_force(const anhyst_plant_circuit *c, const outer_circuit *outer,
                                anhyst_plant_coil *coil)
{
  const double flux = coil->iron.density * c->iron_area * outer->share;
  if (c->cone) {
    double slope;
    coil->over = anhyst_plant_cone_mmf(&outer->cone, flux, coil->over, &slope);
    coil->density = ANHYST_PLANT_MU0 * coil->over / outer->cone.gap;
    coil->force = anhyst_plant_cone_force(&outer->cone, coil->over);
    return;
  }
  coil->density = flux * outer->per_area;
  coil->force = c->bias == 0.0
                    ? flux * coil->density * (1.0 / ANHYST_PLANT_MU0) * outer->fringing_factor
                    : c->bias * flux - c->spring * outer->displacement;
}

static double cone_mmf(void *self, double density, double *slope)
{
  cone_term *term = (cone_term *)self;
  term->mmf = anhyst_plant_cone_mmf(term->at, term->area * density, term->mmf, slope);
  *slope *= term->weight * term->area;
  return term->weight * term->mmf;
}

/* Solves a*H + b*B = r for the field and the flux density of the iron, within a tolerance of the
   flux density. With a cone, the left side also contains its ampere-turns times `weight`. */
static inline void solve_iron(const anhyst_plant_circuit *c, const anhyst_plant_coil *coil,
                              const outer_circuit *outer, const anhyst_plant_asked *asked,
                              double weight, double tolerance, solution *found)
{
  found->mmf = 0.0;
  if (c->cone) {
    cone_term term = {&outer->cone, c->iron_area, weight, coil->over};
    const anhyst_plant_beyond extra_term = {cone_mmf, &term};
    const double min_slope = weight * c->iron_area / (outer->cone.straight + outer->cone.cone);
    anhyst_plant_field(&c->iron, &coil->iron, asked->a, asked->b, asked->r,
                       (asked->b + min_slope) * CONE_TOLERANCE, &extra_term, &found->goal);
    found->mmf = term.mmf;
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

static void advance_iron(const anhyst_plant_circuit *c, anhyst_plant_coil *coil,
                         const solution *found)
{
  if (c->solid) {
    anhyst_plant_soaked_move(&c->iron, c->solid, coil->volume, &coil->iron, &found->solid);
  } else {
    anhyst_plant_move(&c->iron, &coil->iron, &found->goal);
  }
}

static double flux_linkage(const anhyst_plant_flux_table *t, double current, double gap,
                           double *slope)
{
  const double row =
      anhyst_plant_limit_to_range((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0, 1.0) *
      (double)(t->gaps - 1);
  const int above = row >= (double)(t->gaps - 1) ? t->gaps - 2 : (int)row;
  const double row_share = row - (double)above;
  const double step = t->current_high / (double)(t->currents - 1);
  const double column_position = fabs(current) / step;
  const int column =
      column_position >= (double)(t->currents - 1) ? t->currents - 2 : (int)column_position;
  const double *low = t->psi + (size_t)above * (size_t)t->currents + column;
  const double *high = low + t->currents;
  const double begin = low[0] + row_share * (high[0] - low[0]);
  const double end = low[1] + row_share * (high[1] - low[1]);
  *slope = (end - begin) / step;
  return copysign(begin + (column_position - (double)column) * (end - begin), current);
}

static double solve_linkage(const anhyst_plant_flux_table *t, double gap, double b, double r,
                            double start)
{
  double current = start;
  double low = -HUGE_VAL;
  double high = HUGE_VAL;
  int i;
  for (i = 0; i < MAX_ITERATIONS; i++) {
    double slope;
    const double residual = r - flux_linkage(t, current, gap, &slope) - b * current;
    const double next = current + residual / (slope + b);
    if (residual > 0.0) {
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

static anhyst_plant_row interpolate_row(const anhyst_plant_law *law, double gap)
{
  const anhyst_plant_flux_table *t = &law->table;
  const double place =
      anhyst_plant_limit_to_range((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0, 1.0) *
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

/* Moves the law to a current. If there is no solution, its state does not change. The eddy-current
   term uses the backward difference of second order, which causes no ringing. */
static void move_law(const anhyst_plant_law *law, anhyst_plant_coil *coil, double gap,
                     double per_second)
{
  const anhyst_plant_row row = interpolate_row(law, gap);
  const double flux_before = anhyst_flux_of_f64(law->iron, &coil->law);
  const double eddy_mmf = law->eddy * per_second;
  anhyst_circuit_f64 circuit;
  double flux;
  circuit.gap_ratio = row.gap_ratio;
  circuit.eddy = 1.5 * eddy_mmf;
  (void)anhyst_commit_f64(law->iron, &coil->law, &circuit,
                          row.drive * (coil->current - row.zero) + 0.5 * eddy_mmf * coil->stride);
  flux = anhyst_flux_of_f64(law->iron, &coil->law);
  coil->stride = flux - flux_before;
  coil->density = row.density * flux;
  coil->force = row.gain * flux * flux + row.offset;
}

/* Returns the part of the winding current that balances the eddy currents, A per induced volt. */
static double eddy_current_share(const anhyst_plant_magnet *magnet)
{
  const anhyst_plant_circuit *c = magnet->circuit;
  return c && c->eddy > 0.0
             ? c->eddy * c->iron_length / (magnet->turns * magnet->turns * c->iron_area)
             : 0.0;
}

/* Returns the total current from the current without eddy currents. */
static inline double total_current(const anhyst_plant_magnet *magnet, double eddies, double steady,
                                   const anhyst_plant_source *s)
{
  return eddies > 0.0 ? (steady + eddies * (s->gain * s->reference + s->voltage)) /
                            (1.0 + eddies * (s->gain + magnet->resistance))
                      : steady;
}

/* Replaces a source whose voltage exceeds the limit by a source of the limit voltage, and returns
   whether it did. The solved current is then even farther from the reference, so that the limit
   still applies. */
static inline int limit_source(anhyst_plant_source *s, double current)
{
  const double voltage = s->gain * (s->reference - current) + s->voltage;
  if (fabs(voltage) <= s->limit) {
    return 0;
  }
  s->gain = 0.0;
  s->voltage = copysign(s->limit, voltage);
  return 1;
}

/* Solves for iron and current at the end of a step, whose length is twice end->half. The flux
   linkage at the end is end->psi_start plus the terms that depend on the solution. */
static inline void solve_step_end(const anhyst_plant_magnet *magnet, const anhyst_plant_coil *coil,
                                  const anhyst_plant_source *s, const step_end *end,
                                  solution *found)
{
  const double source_voltage = s->gain * s->reference + s->voltage;
  const double total_resistance = s->gain + magnet->resistance;
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    const double half =
        end->eddies > 0.0 ? end->half / (1.0 + end->eddies * total_resistance) : end->half;
    const double per_field = c->iron_length / magnet->turns;
    const double per_density = end->outer.outer * c->iron_area / magnet->turns;
    const double weight = magnet->turns * c->iron_area;
    const double moved = c->bias == 0.0 ? 0.0 : c->bias * end->outer.displacement / magnet->turns;
    const anhyst_plant_asked asked = {
        half * total_resistance * per_field, weight + half * total_resistance * per_density,
        end->psi_start + half * (source_voltage + total_resistance * moved), 0.5 / end->half};
    solve_iron(c, coil, &end->outer, &asked, half * total_resistance / magnet->turns,
               weight * FLUX_DENSITY_TOLERANCE, found);
    found->steady = per_field * found->solid.field + per_density * found->solid.density - moved;
    if (c->cone) {
      found->steady += found->mmf / magnet->turns;
    }
  } else {
    found->steady = solve_linkage(&magnet->law->table, end->gap, end->half * total_resistance,
                                  end->psi_start + end->half * source_voltage, coil->steady);
  }
  found->current = total_current(magnet, end->eddies, found->steady, s);
}

static inline void commit_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                               const step_end *end, const solution *found)
{
  if (magnet->circuit) {
    advance_iron(magnet->circuit, coil, found);
    update_force(magnet->circuit, &end->outer, coil);
  } else {
    move_law(magnet->law, coil, end->gap, 0.5 / end->half);
  }
}

void anhyst_plant_coil_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            const anhyst_plant_source *source, double gap, double seconds)
{
  const double half = 0.5 * seconds;
  anhyst_plant_source s = *source;
  step_end end;
  solution found;
  double start_current;
  double voltage;
  int is_limited;
  end.gap = gap;
  end.half = half;
  end.eddies = eddy_current_share(magnet);
  s.voltage += coil->integral;
  start_current = total_current(magnet, end.eddies, coil->steady, &s);
  is_limited = limit_source(&s, start_current);
  if (is_limited) {
    start_current = total_current(magnet, end.eddies, coil->steady, &s);
  }
  voltage = s.gain * (s.reference - start_current) + s.voltage;
  end.psi_start = coil->psi + half * (voltage - magnet->resistance * start_current);
  coil->heat += half * magnet->resistance * start_current * start_current;
  coil->energy += half * voltage * start_current;

  if (magnet->circuit) {
    find_circuit(magnet->circuit, gap, &end.outer);
  }
  s = *source;
  s.gain += half * s.reset;
  s.voltage += coil->integral + half * s.reset * (s.reference - start_current);
  solve_step_end(magnet, coil, &s, &end, &found);
  if (limit_source(&s, found.current)) {
    is_limited = 1;
    solve_step_end(magnet, coil, &s, &end, &found);
  }
  voltage = s.gain * (s.reference - found.current) + s.voltage;
  coil->psi = end.psi_start + half * (voltage - magnet->resistance * found.current);
  coil->heat += half * magnet->resistance * found.current * found.current;
  coil->energy += half * voltage * found.current;
  coil->steady = found.steady;
  coil->current = found.current;
  coil->voltage = voltage;
  if (!is_limited) {
    coil->integral +=
        half * source->reset * (2.0 * source->reference - start_current - found.current);
  }
  commit_step(magnet, coil, &end, &found);
}

void anhyst_plant_coil_lead(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            double current, double gap, double per_second)
{
  coil->steady = current;
  coil->current = current;
  coil->voltage = magnet->resistance * current;
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    outer_circuit outer;
    find_circuit(c, gap, &outer);
    const double b = outer.outer * c->iron_area;
    const double eddy_mmf = c->eddy * c->iron_length * per_second;
    const double density_before = coil->iron.density;
    const anhyst_plant_asked asked = {c->iron_length, b + eddy_mmf,
                                      magnet->turns * current + c->bias * outer.displacement +
                                          eddy_mmf * density_before,
                                      per_second};
    solution found;
    solve_iron(c, coil, &outer, &asked, 1.0, b * FLUX_DENSITY_TOLERANCE, &found);
    advance_iron(c, coil, &found);
    coil->steady -= eddy_mmf / magnet->turns * (coil->iron.density - density_before);
    update_force(c, &outer, coil);
    coil->psi = magnet->turns * c->iron_area * coil->iron.density;
  } else {
    double slope;
    move_law(magnet->law, coil, gap, per_second);
    coil->psi = flux_linkage(&magnet->law->table, current, gap, &slope);
  }
}

void anhyst_plant_coil_follow(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                              double current, double gap, double seconds)
{
  const double start = coil->current;
  const double step = (current - start) / MOVEMENT_STEPS;
  const double per_second = 1.0 / (seconds / MOVEMENT_STEPS);
  int n;
  for (n = 1; n < MOVEMENT_STEPS; n++) {
    anhyst_plant_coil_lead(magnet, coil, start + n * step, gap, per_second);
  }
  anhyst_plant_coil_lead(magnet, coil, current, gap, per_second);
}
