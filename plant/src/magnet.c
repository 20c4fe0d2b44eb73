/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/magnet.h"

#include <math.h>

/* Of the flux density, T: less than 1e-6 of the largest force of a magnet of 1 T and more. */
#define TOLERANCE 1e-7
#define ITERATIONS 100

typedef struct {
  double outer;  /* reluctance that the flux of the iron passes outside it, 1/H */
  double share;  /* of it that passes the gaps */
  double area;   /* of a gap, fringes included, m^2 */
  double widens; /* 1 - gap*(change of the area for each metre)/area */
} around;

static around around_iron(const anhyst_plant_circuit *c, double gap)
{
  around found;
  double reluctance;
  found.area = (c->pole_width + gap) * (c->pole_depth + gap);
  reluctance = 2.0 * gap / (ANHYST_PLANT_MU0 * found.area);
  found.outer = 1.0 / (1.0 / reluctance + c->leakage);
  found.share = found.outer / reluctance;
  found.widens = 1.0 - gap * (c->pole_width + c->pole_depth + 2.0 * gap) / found.area;
  return found;
}

static void pull(const anhyst_plant_circuit *c, const around *at, anhyst_plant_coil *coil)
{
  const double flux = coil->cells.density * c->iron_area * at->share;
  coil->density = flux / at->area;
  coil->force = flux * coil->density / ANHYST_PLANT_MU0 * at->widens;
}

/* psi(current) at a gap, and its slope. */
static double linkage(const anhyst_plant_flux_table *t, double current, double gap, double *slope)
{
  const double row =
      fmin(fmax((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0), 1.0) * (double)(t->gaps - 1);
  const int above = row >= (double)(t->gaps - 1) ? t->gaps - 2 : (int)row;
  const double between = row - (double)above;
  const double step = t->current_high / (double)(t->currents - 1);
  const double place = fabs(current) / step;
  const int left = place >= (double)(t->currents - 1) ? t->currents - 2 : (int)place;
  const double *low = t->psi + above * t->currents + left;
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
  const double place = fmin(fmax((gap - t->gap_low) / (t->gap_high - t->gap_low), 0.0), 1.0) *
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
  return found;
}

/* Takes the law to a current; where it has no solution its state stays. */
static void law_moves(const anhyst_plant_law *law, anhyst_plant_coil *coil, double gap,
                      double per_second)
{
  const anhyst_plant_row row = row_at(law, gap);
  anhyst_circuit_f64 circuit;
  double flux;
  circuit.gap_ratio = row.gap_ratio;
  circuit.eddy = law->eddy * per_second;
  (void)anhyst_commit_f64(law->iron, &coil->law, &circuit, row.drive * (coil->current - row.zero));
  flux = anhyst_flux_of_f64(law->iron, &coil->law);
  coil->density = flux;
  coil->force = row.gain * flux * flux + row.offset;
}

/* Where the step would go under u = gain*(reference - current) + voltage without limits. */
static double try_step(const anhyst_plant_magnet *magnet, const anhyst_plant_coil *coil,
                       const anhyst_plant_source *s, double gap, double half, double *current)
{
  const double b = half * (s->gain + magnet->resistance);
  const double r = coil->psi + half * (s->gain * s->reference + s->voltage);
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    const around at = around_iron(c, gap);
    const double eddy = c->eddy * c->iron_length / half;
    const double past = eddy * coil->psi / (magnet->turns * c->iron_area);
    const double per_field = c->iron_length / magnet->turns;
    const double per_density = (eddy + at.outer * c->iron_area) / magnet->turns;
    const double weight = magnet->turns * c->iron_area;
    double density;
    const double field =
        anhyst_plant_field(&c->steel, &coil->cells, b * per_field, weight + b * per_density,
                           r + b * past / magnet->turns, weight * TOLERANCE, &density);
    *current = per_field * field + per_density * density - past / magnet->turns;
    return field;
  }
  *current = current_for(&magnet->law->table, gap, b, r, coil->current);
  return 0.0;
}

void anhyst_plant_coil_step(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            const anhyst_plant_source *source, double gap, double seconds)
{
  const double half = 0.5 * seconds;
  double current;
  double field = try_step(magnet, coil, source, gap, half, &current);
  double voltage = source->gain * (source->reference - current) + source->voltage;
  double middle;
  if (fabs(voltage) > source->limit) {
    /* The left side rises with the field, so the limit holds at the new root as well. */
    anhyst_plant_source limited = {0.0, 0.0, 0.0, 0.0};
    voltage = copysign(source->limit, voltage);
    limited.voltage = voltage;
    field = try_step(magnet, coil, &limited, gap, half, &current);
  }
  coil->current = current;
  coil->voltage = voltage;
  coil->heat += seconds * magnet->resistance * current * current;
  coil->energy += seconds * voltage * current;
  if (magnet->circuit) {
    const around at = around_iron(magnet->circuit, gap);
    anhyst_plant_move(&magnet->circuit->steel, &coil->cells, field);
    pull(magnet->circuit, &at, coil);
    middle = magnet->turns * magnet->circuit->iron_area * coil->cells.density;
  } else {
    double slope;
    law_moves(magnet->law, coil, gap, 1.0 / seconds);
    middle = linkage(&magnet->law->table, current, gap, &slope);
  }
  coil->psi = 2.0 * middle - coil->psi;
}

void anhyst_plant_coil_hold(const anhyst_plant_magnet *magnet, anhyst_plant_coil *coil,
                            double current, double gap)
{
  coil->current = current;
  coil->voltage = magnet->resistance * current;
  if (magnet->circuit) {
    const anhyst_plant_circuit *c = magnet->circuit;
    const around at = around_iron(c, gap);
    const double b = at.outer * c->iron_area;
    double density;
    const double field = anhyst_plant_field(&c->steel, &coil->cells, c->iron_length, b,
                                            magnet->turns * current, b * TOLERANCE, &density);
    anhyst_plant_move(&c->steel, &coil->cells, field);
    pull(c, &at, coil);
    coil->psi = magnet->turns * c->iron_area * coil->cells.density;
  } else {
    double slope;
    law_moves(magnet->law, coil, gap, 0.0);
    coil->psi = linkage(&magnet->law->table, current, gap, &slope);
  }
}
