/* SPDX-License-Identifier: Apache-2.0 */
/* An actuator whose armature is moved from outside, its amplifier and its sensors, tick by tick: a
   rig whose force is controlled.

   At tick n: the gap is given, the current flows that the amplifier has reached, the sensors are
   read. What a controller then asks for is given at tick n + 1 and begins to flow from there on.

   The amplifier takes its current from a converter. It follows as a low-pass of first order, no
   faster than the supply allows and never below the low end of its range. What it controls is what
   its shunt reads: an error of the shunt's zero is one of the current. */
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
  double seconds; /* of a tick, in which its iron moves; 0: so slowly that nothing is induced */
  double low;     /* range of the converter, A */
  double high;
  double step;
  double share; /* of what is missing that the amplifier passes in a tick */
  double most;  /* by which it changes in a tick at most, A */
  double zero;  /* what its shunt reads at no current, A */
  anhyst_plant_sensor sensor[ANHYST_HELD_SENSORS]; /* noise comes from outside */
} anhyst_plant_held;

/* All zero: demagnetised, no current. */
typedef struct {
  anhyst_plant_coil coil;
  double reference; /* of the amplifier, A */
  double current;   /* that it drives, A */
  anhyst_plant_sensing sensing[ANHYST_HELD_SENSORS];
  int begun;
} anhyst_plant_held_state;

/* What a tick gives: current, A; force, N; and what the sensors say. */
#define ANHYST_HELD_COLUMNS (2 + ANHYST_HELD_SENSORS)

/* One tick: the current that was asked for at the one before, the gap here, and noise of each
   sensor in the unit of its quantity. */
void anhyst_plant_held_tick(const anhyst_plant_held *held, anhyst_plant_held_state *state,
                            double reference, double gap, const double *noise, double *row);

#ifdef __cplusplus
}
#endif
#endif
