/* SPDX-License-Identifier: Apache-2.0 */
/* A stage with its controller: the virtual plant and the controller in lock-step, as `anhyst
 * simulate` runs them. */
#include <math.h>
#include <string.h>

#include "stage_controller.h"
#include "virtual_plant.h"

/* One value per coordinate (GAP_READ: per gap sensor). The values from PLANT on have the order of
 * write_plant_outputs. */
enum {
  AXES = BEARING_COORDINATES,
  REFERENCE = 1,
  FORWARD = REFERENCE + AXES,
  FRAME = FORWARD + AXES,
  LOAD = FRAME + AXES,
  NOISE,
  COMMAND = NOISE + AXES,
  POSITION,
  POSITION_READ = POSITION + AXES,
  GAP_READ = POSITION_READ + AXES,
  DEMAND = GAP_READ + BEARING_HEADS - STAGE_HEADS,
  STATE = DEMAND + AXES,
  FLAGS,
  PLANT
};

typedef struct {
  virtual_plant plant;
  anhyst_stage_controller controller;
  double frame[AXES]; /* position of the long stroke, m and rad */
  double command;     /* command of the previous tick */
} state_of;

static void relink(const void *tables, void *state)
{
  (void)tables;
  link_plant(&((state_of *)state)->plant);
}

static void write_outputs(const state_of *now, double *values)
{
  write_plant_outputs(&now->plant.plant, values + PLANT);
  for (int i = 0; i < AXES; i++) {
    values[POSITION + i] = now->plant.plant.pose[bearing.coordinate[i].axis] + now->frame[i];
  }
}

/* Returns a coordinate of the pose from the position heads, which follow the gap sensors. */
static double position_read(const double *record, int i)
{
  static const double see[] = STAGE_SEE;
  const double *head = first_value(record, ANHYST_LOOP_GAP_READ) + BEARING_HEADS - STAGE_HEADS;
  double pose = 0.0;
  for (int j = 0; j < STAGE_HEADS; j++) {
    pose += see[i * STAGE_HEADS + j] * head[j];
  }
  return pose;
}

static int start(const void *tables, void *state, double *values)
{
  const double rest[AXES] = {0.0};
  double middle[AXES]; /* position 0: all magnets in the middle of their gaps */
  state_of *now = (state_of *)state;
  relink(tables, state);
  if (!start_plant(&now->plant)) {
    return -1;
  }
  for (int i = 0; i < AXES; i++) {
    now->frame[i] = values[FRAME + i];
    middle[i] = 0.0 - now->frame[i];
  }
  anhyst_plant_place(&bearing, &now->plant.plant, middle, rest);
  write_outputs(now, values);
  return anhyst_stage_controller_start(now->controller);
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  double frame[2 * AXES];
  const double asked = values[COMMAND];
  const int is_known = asked >= 0.0 && asked <= 7.0;
  const uint32_t command = is_known && asked != now->command ? (uint32_t)asked : 0U;
  const anhyst_plant_events events = {values + REFERENCE, values + LOAD, values + NOISE,
                                      values + FORWARD,   &command,      frame};
  const anhyst_loop_controller controller = {now->controller, anhyst_stage_controller_tick};
  const double *record;
  double sum = 0.0;
  int i;
  (void)tables;
  (void)seconds;
  if (!is_known) {
    return "a command is a number from 0 to 7";
  }
  now->command = asked;
  for (i = 0; i < AXES; i++) {
    frame[i] = now->frame[i];
    frame[AXES + i] = now->frame[i] = values[FRAME + i];
  }
  record = run_plant(&now->plant, controller, &events);
  for (i = 0; i < AXES; i++) {
    values[POSITION_READ + i] = position_read(record, i);
    values[DEMAND + i] = first_value(record, ANHYST_LOOP_DEMAND)[i];
    sum += now->plant.plant.pose[bearing.coordinate[i].axis];
  }
  values[STATE] = *first_value(record, ANHYST_LOOP_STATE);
  values[FLAGS] = *first_value(record, ANHYST_LOOP_FLAGS);
  memcpy(values + GAP_READ, first_value(record, ANHYST_LOOP_GAP_READ),
         (size_t)(BEARING_HEADS - STAGE_HEADS) * sizeof *values);
  write_commands(record, values + PLANT);
  write_outputs(now, values);
  return isfinite(sum) ? NULL : "the stage has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), NULL, NULL, relink, start, tick};
