/* SPDX-License-Identifier: Apache-2.0 */
/* A magnetic bearing with its position controller: the virtual plant and the fixed-point C of the
 * controller in lock-step, as `anhyst simulate` runs them. */
#include <math.h>

#include "bearing_controller.h"
#include "controller_numbers.h"
#include "virtual_plant.h"

/* The values from PLANT on have the order of write_plant_outputs. */
enum { TARGET = 1, LOAD, COMMAND, GAP_READ, REFERENCE, DEMAND, STATE, FLAGS, PLANT };

typedef struct {
  virtual_plant plant;
  CONTROLLER controller;
  double command; /* command of the previous tick */
} state_of;

static void relink(const void *tables, void *state)
{
  state_of *now = (state_of *)state;
  CONTROLLER *controller = &now->controller;
  int i;
  (void)tables;
  link_plant(&now->plant);
  controller->position.limits = &CONTROLLER_LIMITS;
  controller->position.settings = &CONTROLLER_SETTINGS;
  for (i = 0; i < BEARING_MAGNETS; i++) {
    controller->position.magnet[i] = &controller->magnet[i];
    controller->magnet[i].method = &anhyst_force_by_compensator_q31;
    controller->magnet[i].compensator.kernel = &CONTROLLER_KERNEL;
    controller->magnet[i].compensator.words = CONTROLLER_PARAMETERS;
  }
}

static int start(const void *tables, void *state, double *values)
{
  state_of *now = (state_of *)state;
  relink(tables, state);
  if (!start_plant(&now->plant)) {
    return -1;
  }
  write_plant_outputs(&now->plant.plant, values + PLANT);
  return CONTROLLER_INIT(&now->controller) == ANHYST_OK ? 0 : -1;
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  const double nothing = 0.0;
  const double asked = values[COMMAND];
  const int is_known = asked >= 0.0 && asked <= 6.0;
  const uint32_t command = is_known && asked != now->command ? (uint32_t)asked : 0U;
  const anhyst_plant_events events = {&values[TARGET], &values[LOAD], &nothing,
                                      &nothing,        &command,      NULL};
  const anhyst_loop_controller controller = {&now->controller.position,
                                             anhyst_bearing_controller_tick};
  const double *record;
  (void)tables;
  (void)seconds;
  if (!is_known) {
    return "a command is a number from 0 to 6";
  }
  record = run_plant(&now->plant, controller, &events);
  now->command = asked;
  values[REFERENCE] = *first_value(record, ANHYST_LOOP_REFERENCE);
  values[GAP_READ] = *first_value(record, ANHYST_LOOP_GAP_READ);
  values[DEMAND] = *first_value(record, ANHYST_LOOP_DEMAND);
  values[STATE] = *first_value(record, ANHYST_LOOP_STATE);
  values[FLAGS] = *first_value(record, ANHYST_LOOP_FLAGS);
  write_commands(record, values + PLANT);
  write_plant_outputs(&now->plant.plant, values + PLANT);
  return isfinite(now->plant.plant.pose[0]) ? NULL : "the bearing has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), NULL, NULL, relink, start, tick};
