/* SPDX-License-Identifier: Apache-2.0 */
/* A stage with its tracking controller: the virtual plant and the controller in lock-step, as
   `anhyst simulate` runs them. */
#include <math.h>

#include "stage_controller.h"
#include "virtual_plant.h"

/* From GAP on as show_plant has it. */
enum { REFERENCE = 1, FORWARD, FRAME, LOAD, NOISE, POSITION, POSITION_READ, GAP_READ, DEMAND, GAP };

typedef struct {
  virtual_plant plant;
  anhyst_stage_controller controller;
  double frame; /* where the long stroke is, m */
} state_of;

static void relink(const void *tables, void *state)
{
  (void)tables;
  link_plant(&((state_of *)state)->plant);
}

static void show(const state_of *now, double *values)
{
  show_plant(&now->plant.plant, values + GAP);
  values[POSITION] = values[GAP] + now->frame;
}

static int start(const void *tables, void *state, double *values)
{
  const double middle = -values[FRAME]; /* where both magnets are in the middle of their gaps */
  state_of *now = (state_of *)state;
  relink(tables, state);
  if (!start_plant(&now->plant)) {
    return -1;
  }
  anhyst_plant_place(&bearing, &now->plant.plant, &middle, &(const double){0.0});
  now->frame = values[FRAME];
  show(now, values);
  return anhyst_stage_controller_start(now->controller);
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  const double frame[] = {now->frame, values[FRAME]};
  /* The first magnet pulls towards smaller positions: the force of the pair has the other sign. */
  const double forward = -values[FORWARD];
  const uint32_t command = 0;
  const anhyst_plant_events events = {&values[REFERENCE], &values[LOAD], &values[NOISE],
                                      &forward,           &command,      frame};
  const anhyst_loop_controller controller = {now->controller, anhyst_stage_controller_tick};
  double record[RECORDED];
  (void)tables;
  (void)seconds;
  run_plant(&now->plant, controller, &events, record);
  values[POSITION_READ] = *recorded(record, ANHYST_LOOP_GAP) + frame[0] + values[NOISE];
  now->frame = frame[1];
  values[GAP_READ] = *recorded(record, ANHYST_LOOP_GAP_READ);
  values[DEMAND] = *recorded(record, ANHYST_LOOP_DEMAND);
  show_commands(record, values + GAP);
  show(now, values);
  return isfinite(now->plant.plant.pose[0]) ? NULL : "the stage has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), build, drop, relink, start, tick};
