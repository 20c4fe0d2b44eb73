/* SPDX-License-Identifier: Apache-2.0 */
/* Constants of a board for the app. They are compiled in, so the link cannot change them. */
#ifndef ANHYST_FIRMWARE_BOARD_H
#define ANHYST_FIRMWARE_BOARD_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/control/supervisor.h"

/* Limits of a plausible sensor value, q30.

   Rule for a stuck sensor: noise of a working converter changes its code. A sensor counts as stuck
   if its code stayed equal for stuck_ticks ticks while the driven current moved by at least
   app_limits.stuck_current. A constant gap does not matter, because noise still changes its code.
   Choose stuck_ticks from the noise floor: if a sample repeats the previous code with probability
   p, the probability of a false alarm in a window is p^stuck_ticks. 0 disables the rule, for a
   sensor with noise below one code. */
typedef struct {
  int32_t low;
  int32_t high;
  int32_t slew;         /* largest change per tick */
  uint16_t stuck_ticks; /* 0..65535 */
} app_sensor_limits;

typedef struct {
  app_sensor_limits gap;
  app_sensor_limits force;
  app_sensor_limits current;
  int32_t current_low; /* limits of the driven current, q31; current_low <= 0 <= current_high */
  int32_t current_high;
  int32_t stuck_current; /* minimum change of the current for the stuck rules, q31 */
  int32_t stuck_demand;  /* minimum change of the demanded force for the rule of still_ticks, q31 */
  uint16_t still_ticks;  /* ticks for which a levitated position may keep its code after demanded
                            force and current changed (stuck_demand, stuck_current); 0: rule off */
  uint16_t max_implausible_samples; /* implausible samples in a row that are tolerated */
  uint16_t missed_ticks;            /* missed ticks in a row that are tolerated */
  uint16_t selftest_ticks;          /* plausible samples in a row that the self-test requires */
  uint16_t ramp_ms;                 /* ramp from full current to zero in the safe state, ms */
  uint16_t heartbeat_ms;            /* upper limit of each setting that is a number of ticks, ms */
  uint16_t has_current_sensor;      /* 1: the measured current is checked (app/current.h) */
} app_limits;

/* A controller (app/app.h). */
typedef struct app app;

/* State of the force body (force/force.h) or the position body (position/position.h). */
typedef struct app_body app_body;

/* Constants of the position body (position/position.h). */
typedef struct app_plan app_plan;

typedef struct {
  const char *name;     /* name of the actuator, as in its A2L file */
  const app_plan *plan; /* for a position body, otherwise NULL */
  const anhyst_kernel *kernel;
  const int16_t *words;    /* built-in parameter block */
  uint16_t words_capacity; /* number of readable words from `words` on */
  const int16_t *scales;   /* units of its signals; a block for other units is refused */
  uint16_t firmware;       /* firmware version: 256*major + minor */
  uint32_t rate;           /* ticks per second, 10..1000000 */
  const app_limits *limits;
} app_board;

/* Returns a time in ticks, rounded up. The two products stay below 2^32. */
static inline uint32_t app_board_ticks(const app_board *board, uint16_t ms)
{
  return (board->rate / 1000U) * ms + ((board->rate % 1000U) * ms + 999U) / 1000U;
}

#endif
