/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/solid.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define VOLUMES ANHYST_PLANT_MAX_VOLUMES
#define MAX_STEPS 60
#define MAX_BISECTIONS 12
/* Flux density tolerance, T: the last step is the first one with smaller changes in all volumes. */
#define FLUX_TOLERANCE 1e-8
/* Flux density tolerance of the laminations, T, and a small coefficient for a unique solution. */
#define LAMINATIONS_TOLERANCE 1e-11
#define LAMINATIONS_FIELD_WEIGHT (1e-9 * ANHYST_PLANT_MU0)

typedef struct {
  const anhyst_plant_iron *iron;
  const anhyst_plant_solid *solid;
  const anhyst_plant_memory *volume;
  const anhyst_plant_memory *sheets;
  const anhyst_plant_asked *asked;
  double before[VOLUMES]; /* mean flux density S_j, T */
} slab_problem;

typedef struct {
  double field[VOLUMES];
  double density[VOLUMES];
  double field_slope[VOLUMES];
  double density_slope[VOLUMES];
  double flux[VOLUMES];     /* mean flux density S_j, T */
  double residual[VOLUMES]; /* residual H_j + drag_j*dS_j/dt - H_(j-1), A/m */
  double surface;           /* field at the surface */
  double sheets_slope;      /* slope of the laminations' field over the flux */
} slab_state;

static double drag_per_step(const slab_problem *slab, int j)
{
  return slab->solid->drag[j] * slab->asked->per_second;
}

/* Solves for the field of the laminations, which carry the whole flux. */
static void solve_laminations(const slab_problem *slab, double flux, anhyst_plant_soaked *found)
{
  anhyst_plant_field(slab->iron, slab->sheets, LAMINATIONS_FIELD_WEIGHT, 1.0,
                     flux + LAMINATIONS_FIELD_WEIGHT * slab->sheets->field, LAMINATIONS_TOLERANCE,
                     NULL, &found->sheets);
}

static void evaluate_slab(const slab_problem *slab, anhyst_plant_soaked *found, slab_state *state)
{
  const anhyst_plant_solid *solid = slab->solid;
  const anhyst_plant_asked *asked = slab->asked;
  double flux = 0.0;
  double given = asked->r;
  int j;
  for (j = solid->volumes - 1; j >= 0; j--) {
    anhyst_plant_goal goal;
    goal.at = found->at[j];
    slab->iron->family->look(slab->iron, &slab->volume[j], &goal);
    state->field[j] = goal.field;
    state->density[j] = goal.density;
    state->field_slope[j] = goal.field_slope;
    state->density_slope[j] = goal.density_slope;
    flux += solid->share[j] * goal.density;
    state->flux[j] = flux;
  }
  state->sheets_slope = 0.0;
  given -= asked->b * flux;
  if (solid->part < 1.0) {
    solve_laminations(slab, flux, found);
    state->sheets_slope = found->sheets.field_slope / found->sheets.density_slope;
    given -= asked->a * (1.0 - solid->part) * found->sheets.field;
  }
  state->surface = given / (asked->a * solid->part);
  for (j = 0; j < solid->volumes; j++) {
    state->residual[j] = state->field[j] +
                         drag_per_step(slab, j) * (state->flux[j] - slab->before[j]) -
                         (j > 0 ? state->field[j - 1] : state->surface);
  }
}

/* Computes the Newton step of all coordinates: a ladder network, whose response to the outer field
   is computed from the middle outwards. Returns the largest flux change of a volume, T. */
static double newton_step(const slab_problem *slab, const slab_state *state, double *step)
{
  const anhyst_plant_solid *solid = slab->solid;
  const anhyst_plant_asked *asked = slab->asked;
  const int last = solid->volumes - 1;
  double admittance[VOLUMES]; /* sums over a volume and all deeper volumes */
  double source[VOLUMES + 1];
  double admittance_inside = 0.0;
  double outside;
  double max_change = 0.0;
  int j;
  source[last + 1] = 0.0;
  for (j = last; j >= 0; j--) {
    admittance[j] =
        admittance_inside + solid->share[j] * state->density_slope[j] / state->field_slope[j];
    admittance_inside = admittance[j] / (1.0 + drag_per_step(slab, j) * admittance[j]);
    source[j] = source[j + 1] -
                admittance_inside * (drag_per_step(slab, j) * source[j + 1] + state->residual[j]);
  }
  outside =
      (asked->a * (1.0 - solid->part) * state->sheets_slope + asked->b) / (asked->a * solid->part);
  outside *= -source[0] / (1.0 + outside * admittance_inside);
  for (j = 0; j <= last; j++) {
    double change;
    outside -= drag_per_step(slab, j) * source[j + 1] + state->residual[j];
    outside /= 1.0 + drag_per_step(slab, j) * admittance[j];
    step[j] = outside / state->field_slope[j];
    change = fabs(solid->share[j] * state->density_slope[j] * step[j]);
    max_change = change > max_change ? change : max_change;
  }
  return max_change;
}

/* Returns the slope of the minimised function along the line between two sets of fluxes. */
static double directional_slope(const slab_problem *slab, const slab_state *at,
                                const slab_state *from, const slab_state *to)
{
  double residual = 0.0;
  double sum = 0.0;
  int j;
  for (j = 0; j < slab->solid->volumes; j++) {
    residual += at->residual[j];
    sum += slab->solid->share[j] * residual * (to->density[j] - from->density[j]);
  }
  return sum;
}

/* Moves along a step. If it is the last step, moves to its end. Otherwise, halves the step until
   the slope has not reversed to more than half its initial size. */
static void advance(const slab_problem *slab, const double *step, int is_last,
                    anhyst_plant_soaked *found, slab_state *state)
{
  double start[VOLUMES];
  double part = 1.0;
  slab_state next;
  int i;
  int j;
  for (j = 0; j < slab->solid->volumes; j++) {
    start[j] = found->at[j];
  }
  memset(&next, 0, sizeof next);
  for (i = 0; i < MAX_BISECTIONS; i++) {
    for (j = 0; j < slab->solid->volumes; j++) {
      found->at[j] = start[j] + part * step[j];
    }
    evaluate_slab(slab, found, &next);
    if (is_last || directional_slope(slab, &next, state, &next) <=
                       -0.5 * directional_slope(slab, state, state, &next)) {
      break;
    }
    part *= 0.5;
  }
  *state = next;
}

void anhyst_plant_soak(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                       const anhyst_plant_memory *volume, const anhyst_plant_memory *sheets,
                       const anhyst_plant_asked *asked, anhyst_plant_soaked *found)
{
  slab_problem slab = {iron, solid, volume, sheets, asked, {0.0}};
  double step[VOLUMES];
  double flux = 0.0;
  double max_change = HUGE_VAL;
  slab_state state;
  int i;
  int j;
  for (j = solid->volumes - 1; j >= 0; j--) {
    flux += solid->share[j] * volume[j].density;
    slab.before[j] = flux;
    found->at[j] = volume[j].at + volume[j].stride;
  }
  memset(&state, 0, sizeof state);
  evaluate_slab(&slab, found, &state);
  for (i = 0; i < MAX_STEPS && max_change > FLUX_TOLERANCE; i++) {
    max_change = newton_step(&slab, &state, step);
    advance(&slab, step, max_change <= FLUX_TOLERANCE, found, &state);
  }
  if (!(solid->part < 1.0)) {
    solve_laminations(&slab, state.flux[0], found);
  }
  found->density = state.flux[0];
  found->field = solid->part * state.surface + (1.0 - solid->part) * found->sheets.field;
}

void anhyst_plant_soaked_move(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                              anhyst_plant_memory *volume, anhyst_plant_memory *sheets,
                              const anhyst_plant_soaked *found)
{
  int j;
  for (j = 0; j < solid->volumes; j++) {
    anhyst_plant_goal goal;
    goal.at = found->at[j];
    iron->family->look(iron, &volume[j], &goal);
    anhyst_plant_move(iron, &volume[j], &goal);
  }
  anhyst_plant_move(iron, sheets, &found->sheets);
}
