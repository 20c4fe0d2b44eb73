/* SPDX-License-Identifier: Apache-2.0 */
/* A piezo stack that pushes a flexure stage: hysteresis, creep and a resonance; and its loop. None
   of it is a law of the package. The stack wants to be longer by

     z    = d*u + b*u^2 - h,       dh = a*du - beta*|du|*h - gamma*du*|h|      (Bouc and Wen)
     free = z + sum_j w_j s_j,     ds_j/dt = (z - s_j)/T_j

   and pushes the stage through its own stiffness:

     m x" + c x' + k x = k*free + F,   u' = (command - u)/T_amplifier

   A load F is told by what it does at rest, load = F/k, m. */
#ifndef ANHYST_PLANT_PIEZO_H
#define ANHYST_PLANT_PIEZO_H

#include "anhyst/control/tracking.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PIEZO_CREEPS 8 /* most terms of the creep */

typedef struct {
  double stroke_per_volt;                  /* d: of the free stack without hysteresis, m/V */
  double bend;                             /* b, m/V^2 */
  double slope;                            /* a: of the hysteretic part where it turns, m/V */
  double beta;                             /* 1/V */
  double gamma;                            /* 1/V */
  double creep_time[ANHYST_PIEZO_CREEPS];  /* T_j, s */
  double creep_share[ANHYST_PIEZO_CREEPS]; /* w_j */
  int creeps;
  double omega;   /* of the stage with the stack, rad/s */
  double damping; /* ratio */
  double kept;    /* of what the amplifier is behind, over one step */
  double step;    /* of the integration, s */
  int steps;      /* in one tick */
} anhyst_piezo;

/* Zero is long rest at 0 V. */
typedef struct {
  double voltage;
  double hysteresis;
  double creep[ANHYST_PIEZO_CREEPS];
  double place; /* of the stage, m */
  double velocity;
} anhyst_piezo_state;

/* Holds a command, V, and a load, m, for one tick. */
void anhyst_piezo_advance(const anhyst_piezo *piezo, anhyst_piezo_state *state, double command,
                          double load);

/* What happens at one tick. */
typedef struct {
  double wanted;   /* displacement that is fed forward, m */
  double expected; /* and what of it should show by now */
  double noise;    /* of the sensor, m */
  double load;     /* from this tick to the next, m */
} anhyst_piezo_event;

/* A stage and what controls it. */
typedef struct {
  const anhyst_piezo *piezo;
  anhyst_tracking *controller; /* of one drive, from displacement to voltage */
  double sensor_step;          /* of its converter, m; 0: none */
  anhyst_piezo_state state;
  double command; /* V; it is put out one tick after the sample it answers */
} anhyst_piezo_loop;

/* What is recorded of a tick, a number each. */
enum {
  ANHYST_PIEZO_PLACE,
  ANHYST_PIEZO_READ,    /* place as the sensor says */
  ANHYST_PIEZO_DEMAND,  /* corrected displacement */
  ANHYST_PIEZO_COMMAND, /* V, from the next tick on */
  ANHYST_PIEZO_COLUMNS
};

void anhyst_piezo_loop_tick(anhyst_piezo_loop *loop, const anhyst_piezo_event *event, double *row);

#ifdef __cplusplus
}
#endif
#endif
