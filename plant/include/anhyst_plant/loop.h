/* SPDX-License-Identifier: Apache-2.0 */
/* A simulated plant and its controller in lock-step, and their recording. At tick n, the sensors
   are read, the controller answers, and the plant advances by one tick. The answer takes effect
   after the plant's dead time. If an amplifier takes a voltage, a digital current controller
   between controller and amplifier runs once per tick. */
#ifndef ANHYST_PLANT_LOOP_H
#define ANHYST_PLANT_LOOP_H

#include <stddef.h>

#include "anhyst_plant/body.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Digital current controller of an amplifier that takes a voltage: u = resistance*reference +
   gain*(reference - read) + integral. With gain 0, it is not used. */
typedef struct {
  double resistance; /* ohm */
  double gain;       /* V/A */
  double reset;      /* integral gain, V/A per tick */
  double limit;      /* state of the integral term, V */
  double integral;   /* V */
} anhyst_plant_current_loop;

/* Number of doubles in the working storage of a loop. */
#define ANHYST_LOOP_STORAGE_SIZE(magnets, heads, coordinates)                                      \
  (4 * (magnets) + 2 * (heads) + 3 * (coordinates))

typedef struct {
  const anhyst_plant_body *body;
  anhyst_plant_state *state;
  anhyst_loop_controller controller;
  anhyst_plant_current_loop *current_loop; /* array of the caller, one for each magnet */
  double *room;   /* storage of the caller, ANHYST_LOOP_STORAGE_SIZE numbers */
  uint64_t ticks; /* number of ticks since the start */
} anhyst_plant_loop;

/* Inputs and disturbances of n ticks. By default, a row per tick has one number per coordinate. */
typedef struct {
  const double *target;    /* target position */
  const double *load;      /* force command of the load drive, N; one per tick */
  const double *inject;    /* disturbance that is added to the position that the controller reads */
  const double *feed;      /* feedforward force of the controller */
  const uint32_t *command; /* one word per tick: the command of controller.h, and disturbance bits.
                              Bit 8 drops the samples of all heads. Bits from 16 on select magnets
                              whose amplifier fails: a short circuit with bit 9, otherwise an open
                              circuit. With one of bits 10 to 12, they select position heads
                              instead: NaN, frozen reading, or a jump */
  const double *frame;     /* position of the frame at each of n + 1 ticks, interpolated linearly.
                              NULL: the frame does not move */
} anhyst_plant_events;

#define ANHYST_INJECT_HEAD_DROPOUT 256U
#define ANHYST_INJECT_SHORT_CIRCUIT 512U
#define ANHYST_INJECT_HEAD_NAN 1024U
#define ANHYST_INJECT_FROZEN_HEAD 2048U
#define ANHYST_INJECT_HEAD_JUMP 4096U
#define ANHYST_INJECT_HEAD_FAULTS                                                                  \
  (ANHYST_INJECT_HEAD_NAN | ANHYST_INJECT_FROZEN_HEAD | ANHYST_INJECT_HEAD_JUMP)
#define ANHYST_INJECTED_JUMP_M 20e-6 /* m */
#define ANHYST_INJECT_FIRST_FAULT_BIT 16

/* The list of recorded signals, one row per tick, with values at its start. Entries: name, unit
   (suffix of a column), unit of rotations, number of columns, and expression for number j. */
#define ANHYST_LOOP_SIGNAL_TABLE(SIGNAL)                                                           \
  SIGNAL(TIME, "t", "s", "s", TICK, (double)loop->ticks * body->tick)                              \
  SIGNAL(REFERENCE, "reference", "m", "rad", COORDINATE, answer->reference[j])                     \
  SIGNAL(POSE, "pose", "m", "rad", COORDINATE, s->pose[body->coordinate[j].axis])                  \
  SIGNAL(VELOCITY, "velocity", "m_per_s", "rad_per_s", COORDINATE,                                 \
         s->velocity[body->coordinate[j].axis])                                                    \
  SIGNAL(DEMAND, "demand", "N", "N_m", COORDINATE, answer->demand[j])                              \
  SIGNAL(WRENCH, "wrench", "N", "N_m", COORDINATE, s->wrench[body->coordinate[j].axis])            \
  SIGNAL(GAP_READ, "gap_read", "m", "m", HEAD, sample->head[j])                                    \
  SIGNAL(FORCE, "force", "N", "N", TICK, s->force)                                                 \
  SIGNAL(LOAD, "load", "N", "N", TICK, s->load)                                                    \
  SIGNAL(GAP, "gap", "m", "m", MAGNET, s->actuator[j].gap)                                         \
  SIGNAL(COMMAND, "command", "A", "A", MAGNET, answer->current[j])                                 \
  SIGNAL(CURRENT, "current", "A", "A", MAGNET, s->actuator[j].coil.current)                        \
  SIGNAL(CURRENT_READ, "current_read", "A", "A", MAGNET, sample->current[j])                       \
  SIGNAL(VOLTAGE, "voltage", "V", "V", MAGNET, s->actuator[j].coil.voltage)                        \
  SIGNAL(FLUX, "flux", "Wb", "Wb", MAGNET, s->actuator[j].coil.psi)                                \
  SIGNAL(DENSITY, "flux_density", "T", "T", MAGNET, s->actuator[j].coil.density)                   \
  SIGNAL(FLUX_READ, "flux_read", "T", "T", MAGNET, sample->flux[j])                                \
  SIGNAL(STATE, "state", "", "", TICK, (double)answer->state)                                      \
  SIGNAL(FLAGS, "flags", "", "", TICK, (double)answer->flags)

#define ANHYST_LOOP_SIGNAL_ENUM(name, text, unit, angular, shape, value) ANHYST_LOOP_##name,
typedef enum {
  ANHYST_LOOP_SIGNAL_TABLE(ANHYST_LOOP_SIGNAL_ENUM) ANHYST_LOOP_SIGNALS
} anhyst_plant_signal;

typedef enum {
  ANHYST_EACH_TICK,
  ANHYST_EACH_COORDINATE,
  ANHYST_EACH_HEAD,
  ANHYST_EACH_MAGNET
} anhyst_plant_shape;

typedef struct {
  const char *name;
  const char *unit;
  const char *angular;
  anhyst_plant_shape shape;
} anhyst_plant_signal_row;

extern const anhyst_plant_signal_row anhyst_plant_signals[ANHYST_LOOP_SIGNALS];

/* Return the number of columns of a signal, and the index of its first column. For
   ANHYST_LOOP_SIGNALS, this index is the number of columns of a row. */
int anhyst_plant_signal_count(const anhyst_plant_body *body, anhyst_plant_signal signal);
int anhyst_plant_signal_column(const anhyst_plant_body *body, anhyst_plant_signal signal);

/* Runs n ticks and records a row for each. Stops early if the pose is no longer finite, or before a
   tick that the controller did not answer. Returns the number of rows. */
size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record);

#ifdef __cplusplus
}
#endif
#endif
