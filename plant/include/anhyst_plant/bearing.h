/* SPDX-License-Identifier: Apache-2.0 */
/* A magnetic bearing on its test rig: one magnet against a load, or a pair against each other.

     mass*gap" = F_load + mass*gravity - F_1 (+ F_2) - damping*gap' + what the end stops push

   The magnets may ride on something that moves: gap' is then the armature's velocity less theirs.

   Each magnet is fed by an amplifier behind a digital-analogue converter. The load is a moving coil
   with a current amplifier (a lag of first order) and a state controller of its own, which renders
   force, damping and stiffness from an encoder.

   Stepped from outside, tick by tick: read what the sensors say at the beginning of a tick, then go
   on by one tick with what was computed from it. The currents take effect so many sub-steps after
   the reading. Inside, a fixed step: the velocity by half a step, the gap, the windings by the
   trapezoidal rule, the velocity by the other half. Second order in the sub-step. */
#ifndef ANHYST_PLANT_BEARING_H
#define ANHYST_PLANT_BEARING_H

#include "anhyst_plant/magnet.h"
#include "anhyst_plant/sensor.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_MAGNETS 2

typedef struct {
  double limit; /* supply voltage, V */
  double gain;  /* of the current controller, V/A; 0: the command is a voltage */
  double reset; /* its integral, V/(A s) */
  double low;   /* range of the command, A or V */
  double high;
  double step; /* of the digital-analogue converter */
} anhyst_plant_amplifier;

typedef struct {
  double share;          /* of a step of force that its amplifier passes in one sub-step */
  double damping;        /* rendered, N s/m */
  double stiffness;      /* rendered, N/m */
  double rest;           /* gap at which the stiffness pushes nothing, m */
  double encoder_step;   /* m */
  double velocity_share; /* of a step that the filter of its velocity passes in a tick */
} anhyst_plant_load;

typedef struct {
  int magnets; /* 1 or 2 */
  anhyst_plant_magnet magnet[ANHYST_PLANT_MAGNETS];
  anhyst_plant_amplifier amplifier;
  anhyst_plant_load load;
  double gap_total; /* of both gaps of a pair, m */
  double mass;      /* kg */
  double damping;   /* of the guide, N s/m */
  double gravity;   /* m/s^2, positive where it opens the gap */
  double stop_low;  /* gaps at which the end stops are, m */
  double stop_high;
  double stop_stiffness; /* N/m */
  double stop_damping;   /* N s/m, while touched */
  double tick;           /* s */
  int substeps;          /* a tick, >= 1 */
  int delay;             /* sub-steps from reading to output, 0..ANHYST_PLANT_DELAY_MOST/2 */
  anhyst_plant_sensor gap_sensor;
  anhyst_plant_sensor current_sensor;
  anhyst_plant_sensor force_sensor;
  anhyst_plant_sensor hall_probe;
} anhyst_plant_bearing;

typedef struct {
  double gap;
  double current[ANHYST_PLANT_MAGNETS];
  double density[ANHYST_PLANT_MAGNETS]; /* flux density, T */
  double force;                         /* net, F_1 - F_2 */
} anhyst_plant_readings;

typedef struct {
  double gap;            /* true, m */
  double velocity;       /* of the armature, m/s: of the gap where the magnets stand still */
  double frame_velocity; /* of the magnets, m/s, to the same side; set from outside */
  double force;          /* of the magnets, net, N */
  double load;           /* of the load drive, N */
  anhyst_plant_coil coil[ANHYST_PLANT_MAGNETS];
  double output[ANHYST_PLANT_MAGNETS]; /* of the converters, A or V */
  double line[ANHYST_PLANT_DELAY_MOST][ANHYST_PLANT_MAGNETS];
  unsigned char due[ANHYST_PLANT_DELAY_MOST]; /* whether line has something for this sub-step */
  unsigned at;                                /* sub-step, modulo ANHYST_PLANT_DELAY_MOST */
  double load_velocity;                       /* as the load drive estimates it */
  double load_gap;                            /* as its encoder said last */
  anhyst_plant_sensing gap_sensing;
  anhyst_plant_sensing current_sensing[ANHYST_PLANT_MAGNETS];
  anhyst_plant_sensing hall_sensing[ANHYST_PLANT_MAGNETS];
  anhyst_plant_sensing force_sensing;
  anhyst_plant_noise noise;
} anhyst_plant_state;

/* At rest on the upper stop (the largest gap) without current or load, the iron demagnetised. */
void anhyst_plant_start(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                        uint64_t seed);

/* Puts the armature somewhere else. */
void anhyst_plant_place(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, double gap,
                        double velocity);

/* Takes the current of a magnet so slowly to another that nothing is induced; there the amplifier
   holds it. */
void anhyst_plant_hold(const anhyst_plant_bearing *bearing, anhyst_plant_state *state, int magnet,
                       double current);

/* What the sensors say now. Once a tick: every reading draws its own noise. */
void anhyst_plant_read(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                       anhyst_plant_readings *readings);

/* Goes on by one tick: commands to the amplifiers (A or V) and to the load drive (N). */
void anhyst_plant_advance(const anhyst_plant_bearing *bearing, anhyst_plant_state *state,
                          const double command[ANHYST_PLANT_MAGNETS], double load);

#ifdef __cplusplus
}
#endif
#endif
