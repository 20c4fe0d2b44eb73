/* SPDX-License-Identifier: Apache-2.0 */
/* A piezo stack that drives a flexure stage, with hysteresis, creep and a resonance; and its
   control loop. It is independent of the hysteresis laws of the package. The free length of the
   stack is

        z = d*u + b*u^2 - h,   dh = a*du - beta*|du|*h - gamma*du*|h|   (Bouc and Wen)
        free = z + sum_j w_j s_j,   ds_j/dt = (z - s_j)/T_j

   The stack pushes the stage through its own stiffness:

        m x" + c x' + k x = k*free + F,   u' = (command - u)/T_amplifier

   A load F is given by its static displacement, load = F/k, m. */
#ifndef ANHYST_PLANT_PIEZO_H
#define ANHYST_PLANT_PIEZO_H

#include "anhyst/control/tracking.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PIEZO_MAX_CREEP_TERMS 8 /* maximum number of creep terms */

typedef struct {
  double stroke_per_volt; /* slope of the stack without hysteresis, m/V */
  double bend;            /* b, m/V^2 */
  double slope;           /* slope of the hysteretic part at a reversal, m/V */
  double beta;            /* 1/V */
  double gamma;           /* 1/V */
  double creep_time[ANHYST_PIEZO_MAX_CREEP_TERMS];  /* T_j, s */
  double creep_share[ANHYST_PIEZO_MAX_CREEP_TERMS]; /* w_j */
  int creeps;
  double omega;   /* natural frequency of stage and stack, rad/s */
  double damping; /* damping ratio */
  double kept;    /* fraction of the amplifier's error that remains after one step */
  double step;    /* step of the integration, s */
  int steps;      /* integration steps per tick */
} anhyst_piezo;

/* All zeros: the state after a long time at 0 V. */
typedef struct {
  double voltage;
  double hysteresis;
  double creep[ANHYST_PIEZO_MAX_CREEP_TERMS];
  double place; /* position of the stage, m */
  double velocity;
} anhyst_piezo_state;

/* Advances by one tick at a constant command, V, and load, m. */
void anhyst_piezo_advance(const anhyst_piezo *piezo, anhyst_piezo_state *state, double command,
                          double load);

typedef struct {
  double wanted;   /* feedforward displacement, m */
  double expected; /* displacement that is expected at present, m */
  double noise;    /* noise of the sensor, m */
  double load;     /* change of the load from this tick to the next, m */
} anhyst_piezo_event;

typedef struct {
  const anhyst_piezo *piezo;
  anhyst_tracking *controller; /* one drive's compensator, from displacement to voltage */
  double sensor_step;          /* step of the sensor's converter, m; 0: none */
  anhyst_piezo_state state;
  double command; /* command of the last tick, V; it takes effect one tick after its sample */
} anhyst_piezo_loop;

/* Recorded columns of a tick, one number each. */
enum {
  ANHYST_PIEZO_PLACE,
  ANHYST_PIEZO_READ,    /* reading of the sensor */
  ANHYST_PIEZO_DEMAND,  /* displacement after the correction by the controller, m */
  ANHYST_PIEZO_COMMAND, /* command, V, effective from the next tick on */
  ANHYST_PIEZO_COLUMNS
};

void anhyst_piezo_loop_tick(anhyst_piezo_loop *loop, const anhyst_piezo_event *event, double *row);

#ifdef __cplusplus
}
#endif
#endif
