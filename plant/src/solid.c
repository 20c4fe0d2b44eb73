/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/solid.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define VOLUMES ANHYST_PLANT_VOLUMES
#define STEPS 60
#define HALVINGS 12
/* Of the flux density, T: a step that moves no volume's share by more is the last one. */
#define CLOSE 1e-8
/* How exactly the sheets carry the flux, T, and by which field that is made sure to have an end. */
#define SHEETS_CLOSE 1e-11
#define SHEETS_FIELD (1e-9 * ANHYST_PLANT_MU0)

typedef struct {
  const anhyst_plant_iron *iron;
  const anhyst_plant_solid *solid;
  const anhyst_plant_memory *volume;
  const anhyst_plant_memory *sheets;
  const anhyst_plant_asked *asked;
  double before[VOLUMES]; /* S_j */
} problem;

/* At one set of coordinates. */
typedef struct {
  double field[VOLUMES];
  double density[VOLUMES];
  double field_slope[VOLUMES];
  double density_slope[VOLUMES];
  double flux[VOLUMES]; /* S_j */
  double left[VOLUMES]; /* H_j + drag_j*dS_j/dt - H_(j-1) */
  double surface;       /* field there */
  double sheets_slope;  /* of their field over the flux */
} look;

static double drag(const problem *of, int j) { return of->solid->drag[j] * of->asked->per_second; }

/* Field of the sheets, which carry all of the flux. */
static void sheets_follow(const problem *of, double flux, anhyst_plant_soaked *found)
{
  anhyst_plant_field(of->iron, of->sheets, SHEETS_FIELD, 1.0,
                     flux + SHEETS_FIELD * of->sheets->field, SHEETS_CLOSE, NULL, &found->sheets);
}

static void look_at(const problem *of, anhyst_plant_soaked *found, look *now)
{
  const anhyst_plant_solid *solid = of->solid;
  const anhyst_plant_asked *asked = of->asked;
  double flux = 0.0;
  double given = asked->r;
  int j;
  for (j = solid->volumes - 1; j >= 0; j--) {
    anhyst_plant_goal goal;
    goal.at = found->at[j];
    of->iron->family->look(of->iron, &of->volume[j], &goal);
    now->field[j] = goal.field;
    now->density[j] = goal.density;
    now->field_slope[j] = goal.field_slope;
    now->density_slope[j] = goal.density_slope;
    flux += solid->share[j] * goal.density;
    now->flux[j] = flux;
  }
  now->sheets_slope = 0.0;
  given -= asked->b * flux;
  if (solid->part < 1.0) {
    sheets_follow(of, flux, found);
    now->sheets_slope = found->sheets.field_slope / found->sheets.density_slope;
    given -= asked->a * (1.0 - solid->part) * found->sheets.field;
  }
  now->surface = given / (asked->a * solid->part);
  for (j = 0; j < solid->volumes; j++) {
    now->left[j] = now->field[j] + drag(of, j) * (now->flux[j] - of->before[j]) -
                   (j > 0 ? now->field[j - 1] : now->surface);
  }
}

/* Newton's step of all coordinates: a ladder, whose answer to the field outside is found from the
   middle outwards. Returns the largest change of a volume's share in the flux density. */
static double newton(const problem *of, const look *now, double *step)
{
  const anhyst_plant_solid *solid = of->solid;
  const anhyst_plant_asked *asked = of->asked;
  const int last = solid->volumes - 1;
  double own[VOLUMES]; /* of the flux in a volume and deeper, over its field */
  double rest[VOLUMES + 1];
  double answer = 0.0;
  double outside;
  double most = 0.0;
  int j;
  rest[last + 1] = 0.0;
  for (j = last; j >= 0; j--) {
    own[j] = answer + solid->share[j] * now->density_slope[j] / now->field_slope[j];
    answer = own[j] / (1.0 + drag(of, j) * own[j]);
    rest[j] = rest[j + 1] - answer * (drag(of, j) * rest[j + 1] + now->left[j]);
  }
  outside =
      (asked->a * (1.0 - solid->part) * now->sheets_slope + asked->b) / (asked->a * solid->part);
  outside *= -rest[0] / (1.0 + outside * answer);
  for (j = 0; j <= last; j++) {
    double moved;
    outside -= drag(of, j) * rest[j + 1] + now->left[j];
    outside /= 1.0 + drag(of, j) * own[j];
    step[j] = outside / now->field_slope[j];
    moved = fabs(solid->share[j] * now->density_slope[j] * step[j]);
    most = moved > most ? moved : most;
  }
  return most;
}

/* Slope of what is least, along the way from one set of fluxes to the other. */
static double along(const problem *of, const look *at, const look *from, const look *to)
{
  double left = 0.0;
  double sum = 0.0;
  int j;
  for (j = 0; j < of->solid->volumes; j++) {
    left += at->left[j];
    sum += of->solid->share[j] * left * (to->density[j] - from->density[j]);
  }
  return sum;
}

/* Goes along a step: to its end if that is the last one, and otherwise by less where the slope has
   turned round by more than half on the way. */
static void advance(const problem *of, const double *step, int is_last, anhyst_plant_soaked *found,
                    look *now)
{
  double start[VOLUMES];
  double part = 1.0;
  look next;
  int i;
  int j;
  for (j = 0; j < of->solid->volumes; j++) {
    start[j] = found->at[j];
  }
  memset(&next, 0, sizeof next);
  for (i = 0; i < HALVINGS; i++) {
    for (j = 0; j < of->solid->volumes; j++) {
      found->at[j] = start[j] + part * step[j];
    }
    look_at(of, found, &next);
    if (is_last || along(of, &next, now, &next) <= -0.5 * along(of, now, now, &next)) {
      break;
    }
    part *= 0.5;
  }
  *now = next;
}

void anhyst_plant_soak(const anhyst_plant_iron *iron, const anhyst_plant_solid *solid,
                       const anhyst_plant_memory *volume, const anhyst_plant_memory *sheets,
                       const anhyst_plant_asked *asked, anhyst_plant_soaked *found)
{
  problem of = {iron, solid, volume, sheets, asked, {0.0}};
  double step[VOLUMES];
  double flux = 0.0;
  double most = HUGE_VAL;
  look now;
  int i;
  int j;
  for (j = solid->volumes - 1; j >= 0; j--) {
    flux += solid->share[j] * volume[j].density;
    of.before[j] = flux;
    found->at[j] = volume[j].at + volume[j].stride;
  }
  memset(&now, 0, sizeof now);
  look_at(&of, found, &now);
  for (i = 0; i < STEPS && most > CLOSE; i++) {
    most = newton(&of, &now, step);
    advance(&of, step, most <= CLOSE, found, &now);
  }
  if (!(solid->part < 1.0)) {
    sheets_follow(&of, now.flux[0], found);
  }
  found->density = now.flux[0];
  found->field = solid->part * now.surface + (1.0 - solid->part) * found->sheets.field;
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
