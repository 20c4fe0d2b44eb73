/* SPDX-License-Identifier: Apache-2.0 */
/* An identified actuator in double precision: from drive (and gap) to output, flux density and
 * field, as the stepper of the model. Each step of the tool is one sample. */
#include <math.h>
#include <stdlib.h>

#include "actuator_numbers.h"
#include "anhyst/law/circuit.h"
#include "anhyst/numeric/elementary.h"
#include "curve.h"
#include "part.h"

enum { DRIVE = 1, SCHEDULE = 2, OUTPUT = ACTUATOR_HAS_SCHEDULE ? 3 : 2, FLUX, FIELD };

/* Circuit around the iron at one value of the scheduling variable. */
typedef struct {
  double turns; /* c_H, A/m per unit of the drive */
  double rho;
  double gamma;
  double gain;
  double drive_zero;
  double output_zero;
} surroundings;

typedef struct {
  anhyst_iron_f64 iron;
#if ACTUATOR_HAS_CELLS
  anhyst_cells_f64 cells;
  anhyst_cell_piece_f64 *rows;
#else
  anhyst_operator_f64 law;
  anhyst_branch_f64 branch;
#endif
} tables_of;

typedef struct {
  anhyst_memory_f64 memory[ACTUATOR_MEMORIES];
  double flux; /* flux density of the iron, without creep, T */
  double creep_flux[ACTUATOR_CREEPS + 1];
  int has_started;
} state_of;

#if ACTUATOR_HAS_CELLS

static int build_law(tables_of *built)
{
  static const double threshold[] = ACTUATOR_THRESHOLDS;
  static const double width[] = ACTUATOR_WIDTHS;
  static const double weight[] = ACTUATOR_WEIGHTS;
  static const double centre[] = ACTUATOR_CENTRES;
  static const anhyst_cell_weights_f64 given = {ACTUATOR_CELLS, ACTUATOR_CURVES, threshold, width,
                                                weight,         ACTUATOR_SHAPE,  centre};
  size_t pieces = 0;
  if (anhyst_cells_lay_f64(&built->cells, &given, ANHYST_CELLS_AIM, &pieces) != ANHYST_OK) {
    return -1;
  }
  built->rows = (anhyst_cell_piece_f64 *)malloc(pieces * sizeof *built->rows);
  if (built->rows == NULL) {
    return -1;
  }
  anhyst_cells_tabulate_f64(&built->cells, &given, built->rows);
  return anhyst_iron_of_cells_f64(&built->iron, &built->cells, ACTUATOR_INTERACTION) == ANHYST_OK
             ? 0
             : -1;
}

static void drop(void *tables) { free(((tables_of *)tables)->rows); }

#else

static int build_law(tables_of *built)
{
  if (ACTUATOR_STEP == ANHYST_STEP_EXACT &&
      anhyst_branch_build_f64(&built->branch, ACTUATOR_PINNING / ACTUATOR_WIDTH) != ANHYST_OK) {
    return -1;
  }
  return anhyst_iron_init_f64(&built->iron, &built->law, ACTUATOR_STEP, ACTUATOR_SATURATION,
                              ACTUATOR_WIDTH, ACTUATOR_PINNING, ACTUATOR_REVERSIBILITY,
                              ACTUATOR_INTERACTION, ACTUATOR_PLAY, &built->branch) == ANHYST_OK
             ? 0
             : -1;
}

static void drop(void *tables) { (void)tables; }

#endif

static int build(void *tables)
{
  tables_of *built = (tables_of *)tables;
  if (build_law(built) != 0) {
    return -1;
  }
#if ACTUATOR_LAYERS > 1
  return anhyst_iron_layers_f64(&built->iron, ACTUATOR_LAYERS, ACTUATOR_SURFACE,
                                ACTUATOR_LAMINATED) == ANHYST_OK
             ? 0
             : -1;
#else
  return anhyst_iron_eddy_circuit_f64(&built->iron, ACTUATOR_EDDY_CIRCUIT) == ANHYST_OK ? 0 : -1;
#endif
}

/* The state contains no pointers. */
static void relink(const void *tables, void *state)
{
  (void)tables;
  (void)state;
}

static const char *look_up(double at, surroundings *found)
{
  static const anhyst_curve curves[] = ACTUATOR_SURROUNDINGS;
  double value[6];
  int i;
  for (i = 0; i < 6; i++) {
    if (anhyst_curve_at(&curves[i], at, &value[i]) != 0) {
      return "so far outside the model's nodes that a parameter leaves its range";
    }
  }
  found->turns = value[0];
  found->rho = value[1];
  found->gamma = value[2];
  found->gain = value[3];
  found->drive_zero = value[4];
  found->output_zero = value[5];
  return found->rho >= 0.0 && found->gamma >= 0.0
             ? NULL
             : "so far outside the model's nodes that a parameter is below 0";
}

static double output_from_flux(const surroundings *around, double flux)
{
  return around->gain * (ACTUATOR_POWER == 2 ? flux * flux : flux) + around->output_zero;
}

/* Returns the present contribution of creep to the flux density. Each creep state has followed
 * the flux density of earlier steps. */
static double creep(const state_of *state, double seconds, double *creep_flux)
{
  static const double times[] = ACTUATOR_TIMES;
  static const double shares[] = ACTUATOR_SHARES;
  double creep_sum = 0.0;
  int i;
  for (i = 0; i < ACTUATOR_CREEPS; i++) {
    const double decay = anhyst_exp_f64(-seconds / times[i]);
    creep_flux[i] = state->has_started ? state->flux + decay * (state->creep_flux[i] - state->flux)
                                       : state->creep_flux[i];
    creep_sum += shares[i] * creep_flux[i];
  }
  return creep_sum;
}

static double schedule_value(const double *values)
{
  return ACTUATOR_HAS_SCHEDULE ? values[SCHEDULE] : 0.0;
}

static int start(const void *tables, void *state, double *values)
{
  surroundings around;
  (void)tables;
  (void)state;
  if (look_up(schedule_value(values), &around) != NULL) {
    return -1;
  }
  values[OUTPUT] = output_from_flux(&around, 0.0);
  values[FLUX] = 0.0;
  values[FIELD] = 0.0;
  return 0;
}

static const char *status_text(anhyst_status status)
{
  switch (status) {
  case ANHYST_OUT_OF_RANGE:
    return "the effective field leaves the range of the law's tables";
  case ANHYST_REFUSED:
    return "even the reversible part of the iron would jump";
  default:
    return "the equation of the law did not converge";
  }
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  const tables_of *built = (const tables_of *)tables;
  state_of *now = (state_of *)state;
  surroundings around;
  anhyst_circuit_f64 circuit;
  anhyst_reaction_f64 reaction;
  anhyst_status status = ANHYST_OK;
  double creep_flux[ACTUATOR_CREEPS + 1];
  double creep_sum = 0.0;
  const char *why = look_up(schedule_value(values), &around);
  int i;
  if (why != NULL) {
    return why;
  }
  circuit.gap_ratio = around.rho;
  circuit.eddy = around.gamma * (1.0 / seconds);
  status = anhyst_forward_f64(&built->iron, now->memory, &circuit,
                              around.turns * (values[DRIVE] - around.drive_zero), &reaction);
  if (status != ANHYST_OK) {
    return status_text(status);
  }
  anhyst_accept_f64(&built->iron, now->memory, &reaction);
  creep_sum = creep(now, seconds, creep_flux);
  for (i = 0; i < ACTUATOR_CREEPS; i++) {
    now->creep_flux[i] = creep_flux[i];
  }
  now->flux = reaction.flux;
  now->has_started = 1;
  values[OUTPUT] = output_from_flux(&around, reaction.flux + creep_sum);
  values[FLUX] = reaction.flux;
  values[FIELD] = reaction.field;
  return NULL;
}

const anhyst_part anhyst_the_part = {
    sizeof(tables_of), sizeof(state_of), build, drop, relink, start, tick};
