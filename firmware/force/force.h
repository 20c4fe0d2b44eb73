/* SPDX-License-Identifier: Apache-2.0 */
/* The body of a control task that makes force: a demand becomes a current by the compensator, or by
   a constant ratio.

   Current flows in run, and in idle while the conditioning sequence runs; in every other state it
   goes to zero along a ramp of app_limits.ramp_ms from full scale and stays there; until it is zero
   there is no way back to run, and so no way round the ramp. */
#ifndef ANHYST_FIRMWARE_FORCE_H
#define ANHYST_FIRMWARE_FORCE_H

#include "app/body.h"
#include "app/current.h"

struct app_body {
  const app_board *board;
  anhyst_compensator compensator; /* words is NULL as long as no block is valid */
  anhyst_supervisor supervisor;
  int32_t target;  /* force demanded, q31 */
  int32_t demand;  /* in force, on its way to the target */
  int32_t drive;   /* current driven, q31 */
  int32_t ramp;    /* step of the ramp to zero, q31 a tick */
  uint16_t flags;  /* of this tick */
  uint8_t swapped; /* whether the current is still on its way to that of a block put in force, or
                      of the other way from force to current */
  uint8_t compensated; /* whether the compensator found the current last */
  app_sensor gap;
  app_sensor force;
  app_current current;
};

/* The state of a controller with its task, without what it knows of its sensors: 208 bytes where a
   pointer has four or fewer, and 120 for each further memory of solid iron. */
typedef char app_force_is_at_most_208_bytes
    [sizeof(struct app_body) - 2 * sizeof(app_sensor) - sizeof(app_current) + 16 <=
             192 + 4 * (sizeof(void *) > 4 ? sizeof(void *) : 4) + 120UL * (ANHYST_MEMORIES - 1)
         ? 1
         : -1];

#endif
