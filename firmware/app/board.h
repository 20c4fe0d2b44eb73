/* SPDX-License-Identifier: Apache-2.0 */
/* What a board states to the app once: constants in its own source, outside anything that can be
   exchanged over the link. */
#ifndef ANHYST_FIRMWARE_BOARD_H
#define ANHYST_FIRMWARE_BOARD_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/control/supervisor.h"

/* What a sensor can plausibly show, q30.

   Stuck: a converter that works shows noise. If its code has stayed the very same for stuck_ticks
   ticks, and in that time the driven current was moved by at least app_limits.stuck_current, the
   sensor counts as stuck. A gap that stands still is no reason: its noise still changes the code.
   So stuck_ticks is chosen from the noise floor: with a probability p that one sample repeats the
   code before it, a false alarm in a window has the probability p^stuck_ticks; 0 switches the rule
   off, for a sensor whose noise stays below one code. */
typedef struct {
  int32_t low;
  int32_t high;
  int32_t slew;         /* largest change from one tick to the next */
  uint16_t stuck_ticks; /* 0..65535 */
} app_sensor_limits;

typedef struct {
  app_sensor_limits gap;
  app_sensor_limits force;
  app_sensor_limits current;
  int32_t current_low; /* q31: the current driven never leaves low..high; low <= 0 <= high */
  int32_t current_high;
  int32_t stuck_current; /* q31 */
  int32_t stuck_demand;  /* q31 */
  uint16_t still_ticks;  /* for which a position in the air may stay on one code after wanted
                            force and current have moved so much; 0 switches the rule off */
  uint16_t
      max_implausible_samples; /* samples in a row that may be implausible before it is a fault */
  uint16_t missed_ticks;       /* ticks in a row that may be left out before it is a fault */
  uint16_t selftest_ticks;     /* plausible samples in a row until the self-test has passed */
  uint16_t ramp_ms;            /* from full current to zero in the safe state */
  uint16_t heartbeat_ms;       /* upper limit of each setting in ticks */
  uint16_t has_current_sensor; /* 1: the measured current is checked, see app/current.h */
} app_limits;

/* A controller (app/app.h). */
typedef struct app app;

/* The state of the body of force (force/force.h) or of position (position/position.h). */
typedef struct app_body app_body;

/* What the body of position is made of (position/position.h). */
typedef struct app_plan app_plan;

typedef struct {
  const char *name;     /* of the actuator, as its description file for XCP is called */
  const app_plan *plan; /* of a body of position */
  const anhyst_kernel *kernel;
  const int16_t *words;    /* parameter block built in */
  uint16_t words_capacity; /* words that may be read there */
  const int16_t *scales;   /* what its signals are counted in, as anhyst_block_misfit takes it: no
                              block made for others is taken */
  uint16_t firmware;       /* version: 256*major + minor */
  uint32_t rate;           /* ticks a second, 10..1000000 */
  const app_limits *limits;
} app_board;

/* Ticks that a time lasts, rounded up. Neither product reaches 2^32. */
static inline uint32_t app_board_ticks(const app_board *board, uint16_t ms)
{
  return (board->rate / 1000U) * ms + ((board->rate % 1000U) * ms + 999U) / 1000U;
}

#endif
