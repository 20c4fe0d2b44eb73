/* SPDX-License-Identifier: Apache-2.0 */
/* The control task: states, force controller, safe state. Knows neither link nor port.

   init -> selftest -> idle -> ready -> run, and fault from everywhere. The first tick leaves init.
   Current flows in run, and in idle while the conditioning sequence runs; in every other state it
   goes to zero along a ramp of app_limits.ramp_ms from full scale and stays there; until it is zero
   there is no way back to run, and so no way round the ramp. A fault keeps
   its first reason until `clear`, which goes through selftest again. */
#ifndef ANHYST_FIRMWARE_CONTROL_H
#define ANHYST_FIRMWARE_CONTROL_H

#include "app/board.h"
#include "app/sensor.h"
#include "link/frames.h"
#include "port/port.h"

/* The state of one controller. */
typedef struct {
  anhyst_compensator compensator; /* words is NULL as long as no block is sound */
  int32_t target;                 /* force demanded, q31 */
  int32_t demand;                 /* in force, on its way to the target */
  int32_t drive;                  /* current driven, q31 */
  int32_t ramp;                   /* step of the ramp to zero, q31 a tick */
  int32_t step;                   /* tick of the conditioning sequence, -1 while it does not run */
  uint32_t tick;                  /* last one computed */
  uint32_t silent;                /* ticks since the last new request */
  uint16_t state;
  uint16_t fault;
  uint16_t flags;
  uint16_t passed;   /* plausible samples in a row in selftest */
  uint16_t doubtful; /* implausible samples in a row */
  uint16_t missed;   /* ticks left out since power on, modulo 65536 */
  uint16_t swapped;  /* whether the current is still on its way to that of a block put in force */
} app_control;

typedef char app_control_is_at_most_128_bytes[sizeof(app_control) <= 128 ? 1 : -1];

/* What it knows of the sensors, beside the state of the controller. */
typedef struct {
  app_sensor gap;
  app_sensor force;
  app_sensor current;
} app_sensors;

/* Starts in init with the board's block; if that is not sound, the first tick goes to fault. Not
   for an interrupt: the block is checked. */
void app_control_start(app_control *control, app_sensors *sensors, const app_board *board);

/* One tick: judges the sample, moves the state, and returns the current to drive, q31.
   sample: without values (PORT_NO_SAMPLE) all three are PORT_RESERVED. settings: the values of the
   settings, each within its range. */
int32_t app_control_tick(app_control *control, app_sensors *sensors, const app_board *board,
                         const int32_t *settings, const port_sample *sample);

/* Does a command between two ticks: LINK_REASON_NONE, or why it cannot be done (state, value,
   current, block); nothing has changed then. */
uint16_t app_control_command(app_control *control, app_sensors *sensors, uint16_t command);

/* Goes on with another sound block for this board, between two ticks. Where current may flow it
   moves no faster than along the ramp to zero until it has reached what the block asks for; a
   conditioning sequence begins anew. */
void app_control_swap(app_control *control, const int16_t *words);

#endif
