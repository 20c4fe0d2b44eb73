/* SPDX-License-Identifier: Apache-2.0 */
/* Force body of a control task: converts a demand to a current by a compensator or a constant
   ratio. Current flows in the state RUN, and in IDLE during the conditioning sequence. In every
   other state the current ramps to zero (app_limits.ramp_ms from full scale). Until it is zero, the
   state cannot return to RUN. */
#ifndef ANHYST_FIRMWARE_FORCE_H
#define ANHYST_FIRMWARE_FORCE_H

#include "app/body.h"
#include "app/current.h"

struct app_body {
  const app_board *board;
  anhyst_compensator compensator; /* words: NULL until a block is valid */
  anhyst_supervisor supervisor;
  int32_t target;         /* demanded force, q31 */
  int32_t demand;         /* demand after the slew limit, q31 */
  int32_t drive;          /* driven current, q31 */
  int32_t ramp_step;      /* step of the ramp, q31 per tick */
  uint16_t flags;         /* flags of this tick */
  uint8_t is_ramping;     /* whether the current still ramps after a change of block or method */
  uint8_t is_compensated; /* whether the last current came from the compensator */
  app_sensor gap;
  app_sensor force;
  app_current current;
};

/* Size without the sensor states: at most 208 bytes with pointers of up to four bytes, plus 120
   bytes per additional memory of a solid core. */
typedef char app_force_is_at_most_208_bytes
    [sizeof(struct app_body) - 2 * sizeof(app_sensor) - sizeof(app_current) + 16 <=
             192 + 4 * (sizeof(void *) > 4 ? sizeof(void *) : 4) + 120UL * (ANHYST_MEMORIES - 1)
         ? 1
         : -1];

#endif
