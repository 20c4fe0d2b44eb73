/* SPDX-License-Identifier: Apache-2.0 */
/* A magnetic bearing with its position controller: the virtual plant and the controller's own fixed
   point C in lock-step, as `anhyst simulate` runs them. */
#include <math.h>

#include "anhyst_plant/loop.h"
#include "bearing_controller.h"
#include "bearing_numbers.h"
#include "controller_numbers.h"
#include "part.h"

enum {
  TARGET = 1,
  LOAD,
  COMMAND,
  FIRST_OUTPUT,
  GAP_READ = FIRST_OUTPUT,
  REFERENCE,
  DEMAND,
  STATE,
  FLAGS,
  GAP,
  VELOCITY,
  FORCE,
  FIRST_OF_MAGNET /* current, flux density, command of each */
};

typedef struct {
  anhyst_plant_state plant;
  CONTROLLER controller;
  double integral[ANHYST_PLANT_MAGNETS]; /* of the current loop, V */
  double command;                        /* of the tick before */
  uint64_t ticks;
} state_of;

/* The numbers of the plant are constants. */
static int build(void *tables)
{
  (void)tables;
  return 0;
}

static void drop(void *tables) { (void)tables; }

static void relink(const void *tables, void *state)
{
  CONTROLLER *controller = &((state_of *)state)->controller;
  int i;
  (void)tables;
  controller->position.limits = &CONTROLLER_LIMITS;
  controller->position.settings = &CONTROLLER_SETTINGS;
  for (i = 0; i < BEARING_MAGNETS; i++) {
    controller->position.magnet[i] = &controller->magnet[i];
    controller->magnet[i].compensator.kernel = &CONTROLLER_KERNEL;
    controller->magnet[i].compensator.words = CONTROLLER_PARAMETERS;
  }
}

/* What is true at the end of a tick. */
static void show(const anhyst_plant_state *plant, double *values)
{
  int i;
  values[GAP] = plant->gap;
  values[VELOCITY] = plant->velocity;
  values[FORCE] = plant->force;
  for (i = 0; i < BEARING_MAGNETS; i++) {
    values[FIRST_OF_MAGNET + 3 * i] = plant->coil[i].current;
    values[FIRST_OF_MAGNET + 3 * i + 1] = plant->coil[i].density;
  }
}

static int start(const void *tables, void *state, double *values)
{
  state_of *now = (state_of *)state;
  (void)tables;
  anhyst_plant_start(&bearing, &now->plant, BEARING_SEED);
  show(&now->plant, values);
  return CONTROLLER_INIT(&now->controller) == ANHYST_OK ? 0 : -1;
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  static const anhyst_plant_current_loop current_loop = BEARING_CURRENT_LOOP;
  state_of *now = (state_of *)state;
  const double nothing = 0.0;
  const uint32_t command =
      values[COMMAND] != now->command ? (uint32_t)fmax(0.0, values[COMMAND]) : 0U;
  const anhyst_plant_events events = {&values[TARGET], &values[LOAD], &nothing,
                                      &nothing,        &command,      NULL};
  anhyst_plant_loop loop = {
      &bearing,        &now->plant, {&now->controller.position, anhyst_bearing_controller_tick},
      current_loop,    {0.0, 0.0},  0,
      BEARING_HAS_HALL};
  double record[ANHYST_LOOP_COLUMNS];
  int i;
  (void)tables;
  (void)seconds;
  if (!(values[COMMAND] >= 0.0 && values[COMMAND] <= 6.0)) {
    return "a command is a number from 0 to 6";
  }
  loop.ticks = now->ticks;
  for (i = 0; i < ANHYST_PLANT_MAGNETS; i++) {
    loop.integral[i] = now->integral[i];
  }
  (void)anhyst_plant_loop_run(&loop, &events, 1, record);
  now->command = values[COMMAND];
  now->ticks = loop.ticks;
  for (i = 0; i < ANHYST_PLANT_MAGNETS; i++) {
    now->integral[i] = loop.integral[i];
  }
  values[REFERENCE] = record[1];
  values[GAP_READ] = record[3];
  values[DEMAND] = record[5];
  values[FIRST_OF_MAGNET + 2] = record[8];
  if (BEARING_MAGNETS > 1) {
    values[FIRST_OF_MAGNET + 3 * (BEARING_MAGNETS - 1) + 2] = record[14];
  }
  values[STATE] = record[16];
  values[FLAGS] = record[17];
  show(&now->plant, values);
  return isfinite(now->plant.gap) ? NULL : "the bearing has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), build, drop, relink, start, tick};
