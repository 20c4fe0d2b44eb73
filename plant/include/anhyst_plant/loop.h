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
#define ANHYST_LOOP_ROOM(magnets, heads, coordinates) (4 * (magnets) + (heads) + 3 * (coordinates))

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
  const uint32_t *command; /* as in controller.h; bit 8: the heads' sample is dropped; one a tick */
  const double *frame;     /* where the frame is at each of n + 1 ticks; straight between. NULL: it
                              stands still */
} anhyst_plant_events;

#define ANHYST_LOOP_DROP 256U

/* Signals of a record: a row a tick, all at its beginning. */
typedef enum {
  ANHYST_LOOP_TIME,
  ANHYST_LOOP_REFERENCE,
  ANHYST_LOOP_POSE,
  ANHYST_LOOP_VELOCITY,
  ANHYST_LOOP_DEMAND,
  ANHYST_LOOP_WRENCH,
  ANHYST_LOOP_GAP_READ,
  ANHYST_LOOP_FORCE,
  ANHYST_LOOP_LOAD,
  ANHYST_LOOP_GAP,
  ANHYST_LOOP_COMMAND,
  ANHYST_LOOP_CURRENT,
  ANHYST_LOOP_CURRENT_READ,
  ANHYST_LOOP_VOLTAGE,
  ANHYST_LOOP_FLUX,
  ANHYST_LOOP_DENSITY,
  ANHYST_LOOP_STATE,
  ANHYST_LOOP_FLAGS,
  ANHYST_LOOP_SIGNALS
} anhyst_plant_signal;

/* How many numbers of it a row has. */
typedef enum {
  ANHYST_LOOP_ONE,
  ANHYST_LOOP_A_COORDINATE,
  ANHYST_LOOP_A_HEAD,
  ANHYST_LOOP_A_MAGNET
} anhyst_plant_shape;

/* The one table of them, in the order of the enumeration. */
typedef struct {
  const char *name;
  const char *unit;    /* as names of columns end with it; empty: a number */
  const char *angular; /* of a coordinate that is an angle */
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
