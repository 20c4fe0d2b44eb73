/* SPDX-License-Identifier: Apache-2.0 */
/* A body that n magnets pull at, free in 1 to 6 coordinates: a bearing with one magnet against a
   load, a pair against each other, a stage of six axes.

     q = (p, th): pose, displacement and small angles;  v: velocity
     M v' = sum W_i f_i + W_load F_load + weight - damping*v + what the end stops push
     q' = v - velocity of the frame

   Whatever acts or measures at one place in one direction is a line, a place r and a unit vector d
   on the frame. How far the body has moved along it, and what a force along it gives, belong
   together, so that energy is kept:

     moved = d.p + th.((r - p) x d),   W = d moved/dq = [d + th x d; (r - p) x d]
     gap_i = zero_i - moved_i,   a position head reads zero + moved

   This is exact for faces that are planes and a rotation matrix of first order. Left out are
   squares of the angles (of a gap half of r*th^2), products of angular rates (gyroscopic moments,
   centrifugal forces), and the tilt of a gap across its pole. A coordinate that is not free stays
   where it is; the guide carries what pushes it.

   A cable goes from a place c on the body to the ground: a spring and a damper, alike along x, y,
   z,

     u = P + th x c,   F_cable = -stiffness*u - damping*u',   P, th: pose and frame together

   Each magnet has an amplifier behind a digital-analogue converter. The frame may move (the long
   stroke of a stage): the pose is seen from the frame, the velocity is absolute. The load is a
   moving coil with a current amplifier (a lag of first order) and a state controller of its own,
   which renders force, damping and stiffness from an encoder.

   Stepped from outside, tick by tick: read what the sensors say at the beginning of a tick, then go
   on by one tick with what was computed from it. The currents take effect so many sub-steps after
   the reading. Inside, a fixed step: the velocity by half a step, the pose, the windings by the
   trapezoidal rule, the velocity by the other half. Second order in the sub-step. In one coordinate
   with d = +1 or -1 every further product is by one or zero and changes no bit. */
#ifndef ANHYST_PLANT_BODY_H
#define ANHYST_PLANT_BODY_H

#include "anhyst_plant/magnet.h"
#include "anhyst_plant/sensor.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_AXES 6 /* x y z, and angles about them */

typedef struct {
  double r[3]; /* from the point that the pose is of, m */
  double d[3]; /* unit vector */
} anhyst_plant_line;

typedef struct {
  double limit; /* supply voltage, V */
  double gain;  /* of the current controller, V/A; 0: the command is a voltage */
  double reset; /* its integral, V/(A s) */
  double low;   /* range of the command, A or V */
  double high;
  double step; /* of the digital-analogue converter */
} anhyst_plant_amplifier;

/* A magnet where it stands, with all that belongs to it. It pulls the body along its line. */
typedef struct {
  anhyst_plant_magnet magnet;
  anhyst_plant_line line;
  double gap_zero; /* gap at pose zero, m */
  anhyst_plant_amplifier amplifier;
  anhyst_plant_sensor current_sensor;
  anhyst_plant_sensor flux_probe;
  int has_probe; /* else its flux density reads as NAN */
} anhyst_plant_actuator;

/* What a head is fixed to: the frame; the body, on which it looks past the frame at something long,
   so that a loop adds how far the frame has moved along its line; or the ground, from where it sees
   another place of the body as that goes on: its line is counted from frame and pose together. */
typedef enum { ANHYST_PLANT_FRAME, ANHYST_PLANT_BODY, ANHYST_PLANT_GROUND } anhyst_plant_base;

/* A position sensor: an interferometer, or the sensor of a gap (zero that gap, d away from it). */
typedef struct {
  anhyst_plant_line line;
  double zero; /* m */
  anhyst_plant_sensor sensor;
  anhyst_plant_base base;
} anhyst_plant_head;

typedef struct {
  double at[3];     /* on the body, m */
  double stiffness; /* N/m; 0: none */
  double damping;   /* N s/m */
} anhyst_plant_cable;

typedef struct {
  anhyst_plant_line line;
  double share;          /* of a step of force that its amplifier passes in one sub-step */
  double damping;        /* rendered, N s/m */
  double stiffness;      /* rendered, N/m */
  double rest;           /* position at which the stiffness pushes nothing, m */
  double encoder_step;   /* m; 0: none */
  double velocity_share; /* of a step that the filter of its velocity passes in a tick */
} anhyst_plant_load;

/* A free coordinate, in m and N or rad and N m. */
typedef struct {
  int axis;        /* 0..5 */
  double rest;     /* where the body lies without currents */
  double damping;  /* of the guide */
  double stop_low; /* where the end stops are */
  double stop_high;
  double stop_stiffness;
  double stop_damping; /* while touched */
} anhyst_plant_coordinate;

/* Arrays are the caller's, as long as counted here. */
typedef struct {
  int coordinates;                                       /* 1..6 */
  anhyst_plant_coordinate coordinate[ANHYST_PLANT_AXES]; /* axes rising */
  double mass;                                           /* kg */
  double centre[3];                                      /* centre of mass, m */
  double inertia[3][3];                                  /* about it, kg m^2 */
  double gravity[3];                                     /* m/s^2 */
  int magnets;
  const anhyst_plant_actuator *actuator;
  int heads;
  const anhyst_plant_head *head;
  anhyst_plant_load load;
  anhyst_plant_cable cable;
  double force_along[3];            /* unit vector: what part of the net force its sensor shows */
  anhyst_plant_sensor force_sensor; /* of the magnets' net force */
  double tick;                      /* s */
  int substeps;                     /* a tick, >= 1 */
  int delay; /* sub-steps from reading to output, 0..ANHYST_PLANT_DELAY_MOST/2 */
} anhyst_plant_body;

/* Where a caller wants its readings. */
typedef struct {
  double *head;    /* each, m */
  double *current; /* of each magnet, A */
  double *density; /* flux density of each, T */
  double force;    /* N */
} anhyst_plant_readings;

/* An open circuit: the current goes back to the supply through diodes, and then there is none. A
   short one: it runs down in the winding. */
typedef enum { ANHYST_PLANT_WORKS, ANHYST_PLANT_OPEN, ANHYST_PLANT_SHORT } anhyst_plant_failure;

typedef struct {
  anhyst_plant_coil coil;
  double gap;                           /* true, m */
  double output;                        /* of the converter, A or V */
  anhyst_plant_failure failure;         /* of the amplifier; set from outside */
  double line[ANHYST_PLANT_DELAY_MOST]; /* outputs to come */
  anhyst_plant_sensing current_sensing;
  anhyst_plant_sensing flux_sensing;
} anhyst_plant_actuator_state;

typedef struct {
  double position; /* true, m */
  anhyst_plant_sensing sensing;
} anhyst_plant_head_state;

typedef struct {
  double pose[ANHYST_PLANT_AXES];           /* true, from the frame; m, rad */
  double velocity[ANHYST_PLANT_AXES];       /* absolute, m/s, rad/s */
  double frame_velocity[ANHYST_PLANT_AXES]; /* of the magnets; set from outside */
  double frame[ANHYST_PLANT_AXES];          /* where they are; set from outside */
  double wrench[ANHYST_PLANT_AXES];         /* of the magnets, N, N m */
  double force;                             /* of the magnets, as its sensor is turned, N */
  double load;                              /* of the load drive, N */
  double ease[ANHYST_PLANT_AXES][ANHYST_PLANT_AXES]; /* velocity that half a sub-step gives for
                                                        each N or N m */
  double tie[ANHYST_PLANT_AXES]
            [ANHYST_PLANT_AXES];              /* force of a cable of 1 N/m for each m or rad */
  double weight[ANHYST_PLANT_AXES];           /* force and moment of gravity, N, N m */
  int can_turn;                               /* whether an angle is a free coordinate */
  anhyst_plant_actuator_state *actuator;      /* the caller's, one a magnet */
  anhyst_plant_head_state *head;              /* and one a head */
  unsigned char due[ANHYST_PLANT_DELAY_MOST]; /* whether lines have something for this sub-step */
  unsigned at;                                /* sub-step, modulo ANHYST_PLANT_DELAY_MOST */
  double load_velocity;                       /* as the load drive estimates it */
  double load_position;                       /* as its encoder said last */
  anhyst_plant_sensing force_sensing;
  anhyst_plant_noise noise;
} anhyst_plant_state;

/* At rest without current or load, the irons demagnetised; the two arrays of the state are given.
   Returns 0 where mass and inertia are those of no body. */
int anhyst_plant_start(const anhyst_plant_body *body, anhyst_plant_state *state, uint64_t seed);

/* Puts the body somewhere else; a number a free coordinate. */
void anhyst_plant_place(const anhyst_plant_body *body, anhyst_plant_state *state,
                        const double *pose, const double *velocity);

/* Puts the frame somewhere else; a number a free coordinate. A head on the ground has seen the body
   there for ever. */
void anhyst_plant_ride(const anhyst_plant_body *body, anhyst_plant_state *state,
                       const double *frame);

/* Takes the current of a magnet so slowly to another that nothing is induced; there the amplifier
   holds it. */
void anhyst_plant_hold(const anhyst_plant_body *body, anhyst_plant_state *state, int magnet,
                       double current);

/* What the sensors say now. Once a tick: every reading draws its own noise. */
void anhyst_plant_read(const anhyst_plant_body *body, anhyst_plant_state *state,
                       anhyst_plant_readings *readings);

/* Goes on by one tick: commands to the amplifiers (A or V) and to the load drive (N). */
void anhyst_plant_advance(const anhyst_plant_body *body, anhyst_plant_state *state,
                          const double *command, double load);

/* How far a body at this pose has moved along a line, m. */
double anhyst_plant_moved(const anhyst_plant_line *line, const double pose[ANHYST_PLANT_AXES]);

#ifdef __cplusplus
}
#endif
#endif
