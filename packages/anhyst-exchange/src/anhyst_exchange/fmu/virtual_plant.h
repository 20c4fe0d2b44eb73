/* SPDX-License-Identifier: Apache-2.0 */
/* The virtual plant in a component, with any controller. Parameters of the plant are constants. */
#ifndef ANHYST_VIRTUAL_PLANT_H
#define ANHYST_VIRTUAL_PLANT_H

#include "anhyst_plant/loop.h"
#include "bearing_numbers.h"
#include "part.h"

/* Maximum number of values per recorded row. */
#define MAX_RECORDED_VALUES (ANHYST_LOOP_SIGNALS * (BEARING_MAGNETS + BEARING_HEADS))

typedef struct {
  anhyst_plant_state plant;
  anhyst_plant_actuator_state actuator[BEARING_MAGNETS];
  anhyst_plant_memory volume[BEARING_MAGNETS][BEARING_VOLUMES];
  anhyst_plant_head_state head[BEARING_HEADS];
  anhyst_plant_current_loop current_loop[BEARING_MAGNETS];
  uint64_t ticks;
  /* Working memory of one tick. It is static, because a stack frame of more than a page needs a
   * run-time library. */
  double workspace[ANHYST_LOOP_STORAGE_SIZE(BEARING_MAGNETS, BEARING_HEADS, ANHYST_PLANT_AXES)];
  double record[MAX_RECORDED_VALUES];
} virtual_plant;

static void link_plant(virtual_plant *now)
{
  now->plant.actuator = now->actuator;
  now->plant.head = now->head;
  for (int i = 0; i < BEARING_MAGNETS; i++) {
    now->actuator[i].coil.volume = now->volume[i];
  }
}

/* Starts the plant, and sets its pointers, which anhyst_plant_start does not keep. */
static int start_plant(virtual_plant *now)
{
  static const anhyst_plant_current_loop current_loops[] = BEARING_CURRENT_LOOPS;
  static const anhyst_plant_memory demagnetised;
  const int started = anhyst_plant_start(&bearing, &now->plant, BEARING_SEED);
  for (int i = 0; i < BEARING_MAGNETS; i++) {
    now->current_loop[i] = current_loops[i];
    for (int j = 0; j < BEARING_VOLUMES; j++) {
      now->volume[i][j] = demagnetised;
    }
  }
  link_plant(now);
  return started;
}

/* Runs one tick and returns its row. */
static const double *run_plant(virtual_plant *now, anhyst_loop_controller controller,
                               const anhyst_plant_events *events)
{
  anhyst_plant_loop loop = {&bearing,          &now->plant,    controller,
                            now->current_loop, now->workspace, now->ticks};
  (void)anhyst_plant_loop_run(&loop, events, 1, now->record);
  now->ticks = loop.ticks;
  return now->record;
}

/* Returns the first value of a signal in a row. */
static const double *first_value(const double *record, anhyst_plant_signal signal)
{
  return record + anhyst_plant_signal_column(&bearing, signal);
}

/* Writes the true values at the end of a tick: velocities, the wrench if there are several
 * coordinates, the force, then gap, current and flux density of each magnet. The fourth value of
 * each magnet is not written. */
static void write_plant_outputs(const anhyst_plant_state *plant, double *values)
{
  int i;
  for (i = 0; i < bearing.coordinates; i++) {
    *values++ = plant->velocity[bearing.coordinate[i].axis];
  }
  for (i = 0; i < bearing.coordinates && bearing.coordinates > 1; i++) {
    *values++ = plant->wrench[bearing.coordinate[i].axis];
  }
  *values++ = plant->force;
  for (i = 0; i < BEARING_MAGNETS; i++, values += 4) {
    values[0] = plant->actuator[i].gap;
    values[1] = plant->actuator[i].coil.current;
    values[2] = plant->actuator[i].coil.density;
  }
}

/* Writes the current reference of each magnet into the values that write_plant_outputs leaves out.
 */
static void write_commands(const double *record, double *values)
{
  const int before = bearing.coordinates > 1 ? 2 * bearing.coordinates + 1 : 2;
  for (int i = 0; i < BEARING_MAGNETS; i++) {
    values[before + 4 * i + 3] = first_value(record, ANHYST_LOOP_COMMAND)[i];
  }
}

#endif
