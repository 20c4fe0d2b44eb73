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
  anhyst_plant_actuator_state actuator[BEARING_MAGNETS];
  anhyst_plant_head_state head[BEARING_HEADS];
  anhyst_plant_current_loop current_loop[BEARING_MAGNETS];
  CONTROLLER controller;
  double command; /* of the tick before */
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
  state_of *now = (state_of *)state;
  CONTROLLER *controller = &now->controller;
  int i;
  (void)tables;
  now->plant.actuator = now->actuator;
  now->plant.head = now->head;
  controller->position.limits = &CONTROLLER_LIMITS;
  controller->position.settings = &CONTROLLER_SETTINGS;
  for (i = 0; i < BEARING_MAGNETS; i++) {
    controller->position.magnet[i] = &controller->magnet[i];
    controller->magnet[i].compensator.kernel = &CONTROLLER_KERNEL;
    controller->magnet[i].compensator.words = CONTROLLER_PARAMETERS;
  }
}

/* The first column of a signal. */
static int column(anhyst_plant_signal signal)
{
  return anhyst_plant_signal_column(&bearing, signal);
}

/* What is true at the end of a tick. */
static void show(const anhyst_plant_state *plant, double *values)
{
  int i;
  values[GAP] = plant->actuator[0].gap;
  values[VELOCITY] = plant->velocity[0];
  values[FORCE] = plant->force;
  for (i = 0; i < BEARING_MAGNETS; i++) {
    values[FIRST_OF_MAGNET + 3 * i] = plant->actuator[i].coil.current;
    values[FIRST_OF_MAGNET + 3 * i + 1] = plant->actuator[i].coil.density;
  }
}

static int start(const void *tables, void *state, double *values)
{
  static const anhyst_plant_current_loop current_loops[] = BEARING_CURRENT_LOOPS;
  state_of *now = (state_of *)state;
  int i;
  relink(tables, state);
  for (i = 0; i < BEARING_MAGNETS; i++) {
    now->current_loop[i] = current_loops[i];
  }
  if (!anhyst_plant_start(&bearing, &now->plant, BEARING_SEED)) {
    return -1;
  }
  show(&now->plant, values);
  return CONTROLLER_INIT(&now->controller) == ANHYST_OK ? 0 : -1;
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  const double nothing = 0.0;
  const uint32_t command =
      values[COMMAND] != now->command ? (uint32_t)fmax(0.0, values[COMMAND]) : 0U;
  const anhyst_plant_events events = {&values[TARGET], &values[LOAD], &nothing,
                                      &nothing,        &command,      NULL};
  double room[ANHYST_LOOP_ROOM(BEARING_MAGNETS, BEARING_HEADS, ANHYST_PLANT_AXES)];
  anhyst_plant_loop loop = {
      &bearing,          &now->plant, {&now->controller.position, anhyst_bearing_controller_tick},
      now->current_loop, room,        0};
  double record[ANHYST_LOOP_SIGNALS * (BEARING_MAGNETS + BEARING_HEADS)];
  int i;
  (void)tables;
  (void)seconds;
  if (!(values[COMMAND] >= 0.0 && values[COMMAND] <= 6.0)) {
    return "a command is a number from 0 to 6";
  }
  loop.ticks = now->ticks;
  (void)anhyst_plant_loop_run(&loop, &events, 1, record);
  now->command = values[COMMAND];
  now->ticks = loop.ticks;
  values[REFERENCE] = record[column(ANHYST_LOOP_REFERENCE)];
  values[GAP_READ] = record[column(ANHYST_LOOP_GAP_READ)];
  values[DEMAND] = record[column(ANHYST_LOOP_DEMAND)];
  for (i = 0; i < BEARING_MAGNETS; i++) {
    values[FIRST_OF_MAGNET + 3 * i + 2] = record[column(ANHYST_LOOP_COMMAND) + i];
  }
  values[STATE] = record[column(ANHYST_LOOP_STATE)];
  values[FLAGS] = record[column(ANHYST_LOOP_FLAGS)];
  show(&now->plant, values);
  return isfinite(now->plant.pose[0]) ? NULL : "the bearing has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), build, drop, relink, start, tick};
