/* SPDX-License-Identifier: Apache-2.0 */
/* A rig with a force controller: an actuator whose armature moves on a given path, its amplifier
   and its sensors.

   At tick n, the gap is set, the present current of the amplifier flows, and the sensors are read.
   The amplifier gets the controller's reference at tick n + 1, and its current changes from then
   on. The reference comes from a converter. The amplifier follows as a first-order low-pass, with a
   limited rate (supply voltage) and never below the low end of its range. It controls the current
   that its shunt reads, so that a zero error of the shunt is a current error. */
#ifndef ANHYST_PLANT_HELD_H
#define ANHYST_PLANT_HELD_H

#include "anhyst_plant/magnet.h"
#include "anhyst_plant/sensor.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { ANHYST_HELD_GAP, ANHYST_HELD_FORCE, ANHYST_HELD_CURRENT, ANHYST_HELD_SENSORS };

typedef struct {
  anhyst_plant_magnet magnet;
  double seconds; /* length of a tick, s; 0: so slow that nothing is induced */
  double low;     /* ends of the converter's range, A */
  double high;
  double step;
  double share; /* fraction of the control error that the amplifier removes in one tick */
  double most;  /* maximum change of the current per tick, A */
  double zero;  /* reading of the amplifier's shunt without current, A */
  anhyst_plant_sensor sensor[ANHYST_HELD_SENSORS]; /* noise is an input of each tick */
} anhyst_plant_held;

/* All zeros: demagnetised, no current. */
typedef struct {
  anhyst_plant_coil coil;
  double reference; /* input of the amplifier, A */
  double current;   /* output of the amplifier, A */
  anhyst_plant_sensing sensing[ANHYST_HELD_SENSORS];
  int begun;
} anhyst_plant_held_state;

/* Columns of a recorded tick: current, A; force, N; and the sensor readings. */
#define ANHYST_HELD_COLUMN_COUNT (2 + ANHYST_HELD_SENSORS)

/* Executes one tick: the reference of the last tick, the present gap, and the noise of each sensor
   in the unit of its quantity. */
void anhyst_plant_held_tick(const anhyst_plant_held *held, anhyst_plant_held_state *state,
                            double reference, double gap, const double *noise, double *row);

#ifdef __cplusplus
}
#endif
#endif
