/* SPDX-License-Identifier: Apache-2.0 */
/* Constants of a board for the app. They are compiled in, so the link cannot change them. */
#ifndef ANHYST_FIRMWARE_BOARD_H
#define ANHYST_FIRMWARE_BOARD_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/control/supervisor.h"

/* Limits of a plausible sensor value, q30.

   Stuck: a working converter shows noise. A sensor counts as stuck if its code stayed equal for
   stuck_ticks ticks while the driven current moved by at least app_limits.stuck_current. A constant
   gap is no problem, because noise still changes its code. Choose stuck_ticks from the noise floor:
   if a sample repeats the code before it with probability p, the probability of a false alarm in a
   window is p^stuck_ticks. 0 disables the rule, for a sensor with noise below one code. */
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
  int32_t current_low; /* q31: limits of the driven current; current_low <= 0 <= current_high */
  int32_t current_high;
  int32_t stuck_current; /* q31: minimum change of current for the stuck rules */
  int32_t stuck_demand;  /* q31: minimum change of demanded force for the rule of still_ticks */
  uint16_t still_ticks;  /* ticks that a levitated position may keep its code after demanded force
                            and current changed (stuck_demand, stuck_current); 0: rule off */
  uint16_t max_implausible_samples; /* implausible samples in a row before a fault */
  uint16_t missed_ticks;            /* skipped ticks in a row before a fault */
  uint16_t selftest_ticks;          /* plausible samples in a row that pass the self-test */
  uint16_t ramp_ms;                 /* ramp from full current to zero in the safe state, ms */
  uint16_t heartbeat_ms;            /* upper limit of each setting in ticks, ms */
  uint16_t has_current_sensor;      /* 1: the measured current is checked (app/current.h) */
} app_limits;

/* A controller (app/app.h). */
typedef struct app app;

/* State of the body of force (force/force.h) or of position (position/position.h). */
typedef struct app_body app_body;

/* Constants of the body of position (position/position.h). */
typedef struct app_plan app_plan;

typedef struct {
  const char *name;     /* name of the actuator, as in its A2L file */
  const app_plan *plan; /* for a body of position, else NULL */
  const anhyst_kernel *kernel;
  const int16_t *words;    /* built-in parameter block */
  uint16_t words_capacity; /* readable words from `words` on */
  const int16_t *scales;   /* units of its signals; a block for other units is refused */
  uint16_t firmware;       /* version: 256*major + minor */
  uint32_t rate;           /* ticks per second, 10..1000000 */
  const app_limits *limits;
} app_board;

/* Returns a time in ticks, rounded up. Neither product reaches 2^32. */
static inline uint32_t app_board_ticks(const app_board *board, uint16_t ms)
{
  return (board->rate / 1000U) * ms + ((board->rate % 1000U) * ms + 999U) / 1000U;
}

#endif
