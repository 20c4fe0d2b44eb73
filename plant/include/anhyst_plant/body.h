/* SPDX-License-Identifier: Apache-2.0 */
/* A body with 1 to 6 free coordinates on which n magnets act: a bearing with one magnet against a
   load, a pair of opposing magnets, or a stage with six axes.

     q = (p, th): pose, displacement and small angles;  v: velocity
     M v' = sum W_i f_i + W_load F_load + weight - damping*v + forces of the end stops
     q' = v - velocity of the frame

   An actuator or sensor that acts at one point in one direction is a line: a point r and a unit
   vector d on the frame. The motion of the body along the line and the wrench of a force along it
   are consistent, so that energy is conserved:

     moved = d.p + th.((r - p) x d),   W = d moved/dq = [d + th x d; (r - p) x d]
     gap_i = zero_i - moved_i,   a position head reads zero + moved

   This is exact for plane faces and a rotation matrix of first order. The model neglects squares of
   the angles (r*th^2/2 of a gap), products of angular rates (gyroscopic moments, centrifugal
   forces), and the tilt of a gap across its pole. A coordinate that is not free stays constant; the
   guide takes its load.

   A cable connects a point c of the body to the ground: a spring and a damper, equal along x, y, z,

     u = P + th x c,   F_cable = -stiffness*u - damping*u',   P, th: sum of pose and frame

   Each magnet has an amplifier with a digital-analogue converter. The frame may move (the long
   stroke of a stage): the pose is relative to the frame, the velocity is absolute. The load is a
   moving coil with a current amplifier (a first-order lag) and its own state controller, which
   produces force, damping and stiffness from an encoder.

   The caller advances the body tick by tick: it reads the sensors at the start of a tick, then
   advances by one tick with the computed commands. The currents take effect `delay` sub-steps after
   the reading. The integration has a fixed sub-step. It advances the velocity by half a sub-step,
   the pose, the windings by the trapezoidal rule, and the velocity by the other half. It is of
   second order. In one coordinate with d = +1 or -1, all other factors are one or zero. */
#ifndef ANHYST_PLANT_BODY_H
#define ANHYST_PLANT_BODY_H

#include "anhyst_plant/magnet.h"
#include "anhyst_plant/sensor.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_PLANT_AXES 6 /* x y z, and rotations about them */

typedef struct {
  double r[3]; /* vector from the reference point of the pose, m */
  double d[3]; /* unit vector */
} anhyst_plant_line;

typedef struct {
  double limit; /* supply voltage, V */
  double gain;  /* proportional gain of the current controller, V/A; 0: the command is a voltage */
  double reset; /* integral gain of the current controller, V/(A s) */
  double low;   /* ends of the command range, A or V */
  double high;
  double step; /* step of the digital-analogue converter, A or V */
} anhyst_plant_amplifier;

/* Sensor of the flux. HALL: the flux density in the gap. SENSE_COIL and WINDING: the mean voltage
   of a sense coil around the iron, or of the winding itself, during the last tick. */
typedef enum {
  ANHYST_PLANT_NO_PROBE,
  ANHYST_PLANT_HALL,
  ANHYST_PLANT_SENSE_COIL,
  ANHYST_PLANT_WINDING
} anhyst_plant_probe;

/* A magnet with its line, amplifier and sensors. It pulls the body in the direction of its line. */
typedef struct {
  anhyst_plant_magnet magnet;
  anhyst_plant_line line;
  double gap_zero; /* gap at pose zero, m */
  anhyst_plant_amplifier amplifier;
  anhyst_plant_sensor current_sensor;
  anhyst_plant_sensor flux_probe;
  int has_probe;      /* a value of anhyst_plant_probe; without a probe, the reading is NAN */
  double sense_turns; /* turns of the sense coil divided by those of the winding */
} anhyst_plant_actuator;

/* Mounting of a head. FRAME: on the frame. BODY: on the body; it measures to a long target next to
   the frame, and a loop adds the motion of the frame along its line. GROUND: on the ground; its
   point on the body changes as the body moves, and its line is relative to frame plus pose. */
typedef enum { ANHYST_PLANT_FRAME, ANHYST_PLANT_BODY, ANHYST_PLANT_GROUND } anhyst_plant_base;

/* A position sensor: an interferometer, or a gap sensor (`d` points away from the gap). */
typedef struct {
  anhyst_plant_line line;
  double zero; /* reading at pose zero, m */
  anhyst_plant_sensor sensor;
  anhyst_plant_base base;
} anhyst_plant_head;

typedef struct {
  double at[3];     /* attachment point on the body, m */
  double stiffness; /* stiffness, N/m; 0: no cable */
  double damping;   /* N s/m */
} anhyst_plant_cable;

typedef struct {
  anhyst_plant_line line;
  double share;          /* fraction of a force step that its amplifier passes in one sub-step */
  double damping;        /* damping from the load's controller, N s/m */
  double stiffness;      /* stiffness from the load's controller, N/m */
  double rest;           /* position at which the stiffness gives no force, m */
  double encoder_step;   /* resolution, m; 0: ideal */
  double velocity_share; /* fraction of a velocity step that its filter passes in a tick */
} anhyst_plant_load;

/* A free coordinate, in m and N or rad and N m. */
typedef struct {
  int axis;        /* 0..5 */
  double rest;     /* position of the body without currents, m or rad */
  double damping;  /* damping of the guide */
  double stop_low; /* lower and upper position of the end stops */
  double stop_high;
  double stop_stiffness;
  double stop_damping; /* additional damping during contact with a stop */
} anhyst_plant_coordinate;

/* The arrays belong to the caller and have the lengths stated here. */
typedef struct {
  int coordinates;                                       /* 1..6 */
  anhyst_plant_coordinate coordinate[ANHYST_PLANT_AXES]; /* sorted by axis */
  double mass;                                           /* kg */
  double centre[3];                                      /* centre of mass, m */
  double inertia[3][3];                                  /* inertia about the centre, kg m^2 */
  double gravity[3];                                     /* m/s^2 */
  int magnets;
  const anhyst_plant_actuator *actuator;
  int heads;
  const anhyst_plant_head *head;
  anhyst_plant_load load;
  anhyst_plant_cable cable;
  double force_along[3];            /* unit vector: direction of the force sensor */
  anhyst_plant_sensor force_sensor; /* sensor of the magnets' net force */
  double tick;                      /* length of a tick, s */
  int substeps;                     /* sub-steps per tick, >= 1 */
  int delay; /* dead time from reading to output, sub-steps, 0..ANHYST_PLANT_MAX_DELAY/2 */
} anhyst_plant_body;

/* Destinations of the sensor readings. */
typedef struct {
  double *head;    /* readings of the position heads, m */
  double *current; /* current readings of the magnets, A */
  double *density; /* flux density readings of the magnets, T, or voltages of their coils, V */
  double force;    /* N */
} anhyst_plant_readings;

/* Failure of an amplifier. OPEN: open circuit; the current flows back to the supply through diodes
   until it is zero. SHORT: short circuit; the current decays in the winding. */
typedef enum { ANHYST_PLANT_WORKS, ANHYST_PLANT_OPEN, ANHYST_PLANT_SHORT } anhyst_plant_failure;

typedef struct {
  anhyst_plant_coil coil;
  double gap;                          /* true gap, m */
  double area;                         /* integral of the winding's voltage over this tick, V s */
  double psi_start;                    /* flux linkage at the start of this tick, Wb */
  double output;                       /* output of the digital-analogue converter, A or V */
  anhyst_plant_failure failure;        /* failure of the amplifier; the caller sets it */
  double line[ANHYST_PLANT_MAX_DELAY]; /* converter outputs that are not yet effective */
  anhyst_plant_sensing current_sensing;
  anhyst_plant_sensing flux_sensing;
} anhyst_plant_actuator_state;

typedef struct {
  double position; /* true position, m */
  anhyst_plant_sensing sensing;
} anhyst_plant_head_state;

typedef struct {
  double pose[ANHYST_PLANT_AXES];                    /* true pose relative to the frame, m, rad */
  double velocity[ANHYST_PLANT_AXES];                /* absolute velocity, m/s, rad/s */
  double frame_velocity[ANHYST_PLANT_AXES];          /* velocity of the frame; the caller sets it */
  double frame[ANHYST_PLANT_AXES];                   /* position of the frame; the caller sets it */
  double wrench[ANHYST_PLANT_AXES];                  /* total wrench of the magnets, N, N m */
  double force;                                      /* magnets' force along the sensor, N */
  double load;                                       /* force of the load drive, N */
  double ease[ANHYST_PLANT_AXES][ANHYST_PLANT_AXES]; /* velocity change per force in a half-step */
  double tie[ANHYST_PLANT_AXES][ANHYST_PLANT_AXES];  /* cable force per N/m and coordinate */
  double weight[ANHYST_PLANT_AXES];                  /* force and moment of gravity, N, N m */
  int can_turn;                                      /* whether a rotation is a free coordinate */
  anhyst_plant_actuator_state *actuator;             /* array of the caller, one for each magnet */
  anhyst_plant_head_state *head;                     /* array of the caller, one for each head */
  unsigned char due[ANHYST_PLANT_MAX_DELAY]; /* whether new outputs take effect in each sub-step */
  unsigned at;                               /* sub-step modulo ANHYST_PLANT_MAX_DELAY */
  double load_velocity;                      /* velocity that the load drive estimates, m/s */
  double load_position;                      /* last encoder reading of the load's controller, m */
  anhyst_plant_sensing force_sensing;
  anhyst_plant_noise noise;
} anhyst_plant_state;

/* Initialises the state at rest without current or load, with demagnetised iron; the two arrays of
   the state must be set. Returns 0 if the mass or the inertia is impossible. */
int anhyst_plant_start(const anhyst_plant_body *body, anhyst_plant_state *state, uint64_t seed);

/* Sets pose and velocity of the body; each array has one number per free coordinate. */
void anhyst_plant_place(const anhyst_plant_body *body, anhyst_plant_state *state,
                        const double *pose, const double *velocity);

/* Moves the frame, one number for each free coordinate. Heads on the ground settle at its end. */
void anhyst_plant_ride(const anhyst_plant_body *body, anhyst_plant_state *state,
                       const double *frame);

/* Changes the current of a magnet so slowly that nothing is induced; its amplifier keeps it. */
void anhyst_plant_hold(const anhyst_plant_body *body, anhyst_plant_state *state, int magnet,
                       double current);

/* Reads all sensors. Call this once per tick, because every reading contains new noise. */
void anhyst_plant_read(const anhyst_plant_body *body, anhyst_plant_state *state,
                       anhyst_plant_readings *readings);

/* Advances by one tick with the commands to the amplifiers (A or V) and to the load drive (N). */
void anhyst_plant_advance(const anhyst_plant_body *body, anhyst_plant_state *state,
                          const double *command, double load);

/* Returns the displacement of a body at this pose along a line, m. */
double anhyst_plant_displacement(const anhyst_plant_line *line,
                                 const double pose[ANHYST_PLANT_AXES]);

#ifdef __cplusplus
}
#endif
#endif
