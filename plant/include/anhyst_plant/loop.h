/* SPDX-License-Identifier: Apache-2.0 */
/* A plant and its controller in lock-step, and what is recorded of them.

   At tick n: the sensors are read, the controller answers, the plant goes on by one tick; the
   answer takes effect where the plant's delay says. Where an amplifier takes a voltage, a digital
   current controller stands between the two and runs once a tick. */
#ifndef ANHYST_PLANT_LOOP_H
#define ANHYST_PLANT_LOOP_H

#include <stddef.h>

#include "anhyst_plant/body.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* u = resistance*reference + gain*(reference - read) + integral; gain 0: not needed. */
typedef struct {
  double resistance; /* ohm */
  double gain;       /* V/A */
  double reset;      /* of the integral, V/A a tick */
  double limit;      /* V */
  double integral;   /* V */
} anhyst_plant_current_loop;

/* Numbers that a loop needs room for. */
#define ANHYST_LOOP_ROOM(magnets, heads, coordinates)                                              \
  (4 * (magnets) + 2 * (heads) + 3 * (coordinates))

typedef struct {
  const anhyst_plant_body *body;
  anhyst_plant_state *state;
  anhyst_loop_controller controller;
  anhyst_plant_current_loop *current_loop; /* the caller's, one a magnet */
  double *room;                            /* the caller's, ANHYST_LOOP_ROOM numbers */
  uint64_t ticks;                          /* gone so far */
} anhyst_plant_loop;

/* What happens at each of n ticks; a row a tick, a number a free coordinate where not said
   otherwise. */
typedef struct {
  const double *target;    /* wanted position */
  const double *load;      /* force commanded to the load drive, N; one a tick */
  const double *inject;    /* added to what the controller sees of the position */
  const double *feed;      /* force that the controller is given */
  const uint32_t *command; /* as in controller.h; bit 8: the heads' sample is dropped; from bit 16
                              on a magnet each: its amplifier fails, with bit 9 as a short circuit,
                              else as an open one. With one of bits 10 to 12 a position head
                              each: it says no number, what it said last, or too much; one a tick */
  const double *frame;     /* where the frame is at each of n + 1 ticks; straight between. NULL: it
                              stands still */
} anhyst_plant_events;

#define ANHYST_LOOP_DROP 256U
#define ANHYST_LOOP_SHORT 512U
#define ANHYST_LOOP_MISSING 1024U
#define ANHYST_LOOP_FROZEN 2048U
#define ANHYST_LOOP_JUMPS 4096U
#define ANHYST_LOOP_HEADS (ANHYST_LOOP_MISSING | ANHYST_LOOP_FROZEN | ANHYST_LOOP_JUMPS)
#define ANHYST_LOOP_JUMP 20e-6 /* m */
#define ANHYST_LOOP_FAILS 16

/* The one table of what is recorded, a row a tick, all at its beginning: name, unit as columns end
   with it, that of a coordinate that is an angle, how many a row has, and where loop.c takes it
   from for number j. */
#define ANHYST_LOOP_TABLE(SIGNAL)                                                                  \
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

#define ANHYST_LOOP_ENUM(name, text, unit, angular, shape, value) ANHYST_LOOP_##name,
typedef enum { ANHYST_LOOP_TABLE(ANHYST_LOOP_ENUM) ANHYST_LOOP_SIGNALS } anhyst_plant_signal;

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

/* How many columns a signal has, and which is its first; of ANHYST_LOOP_SIGNALS that is the width
   of a row. */
int anhyst_plant_signal_count(const anhyst_plant_body *body, anhyst_plant_signal signal);
int anhyst_plant_signal_column(const anhyst_plant_body *body, anhyst_plant_signal signal);

/* Runs n ticks and fills n rows. Stops early where the pose ceases to be finite, and before a tick
   that the controller did not answer; returns the rows filled. */
size_t anhyst_plant_loop_run(anhyst_plant_loop *loop, const anhyst_plant_events *events, size_t n,
                             double *record);

#ifdef __cplusplus
}
#endif
#endif
