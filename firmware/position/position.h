/* SPDX-License-Identifier: Apache-2.0 */
/* Position body of a control task: levitates an armature; position in, currents out. It runs the
   same controller as anhyst simulate (anhyst/control/position.h), with limits and settings from
   anhyst compile. anhyst/control/levitation.h describes the phases. */
#ifndef ANHYST_FIRMWARE_POSITION_H
#define ANHYST_FIRMWARE_POSITION_H

#include "anhyst/control/position.h"
#include "app/body.h"
#include "app/current.h"

struct app_plan {
  const anhyst_position_limits_q31 *limits;
  const anhyst_position_settings_q31 *settings;
  uint16_t magnets; /* 1 or 2 */
};

/* Detection of a stuck position: it keeps its code although demanded force and current changed. */
typedef struct {
  int32_t code;   /* last new code of the position */
  int32_t demand; /* demanded force at the last new code, q31 */
  int32_t drive;  /* driven current at the last new code, q31 */
  uint32_t ticks; /* ticks since both had changed by stuck_demand and stuck_current */
} app_stillness;

struct app_body {
  const app_board *board;
  anhyst_position_q31 position;
  anhyst_force_controller_q31 magnet[ANHYST_POSITION_MAGNETS];
  anhyst_position_answer_q31 answer;     /* output of the last tick */
  anhyst_position_settings_q31 tuned[2]; /* tuned gains: active and free buffer */
  int32_t target;                        /* target position, q31 */
  app_stillness still;
  app_current current[PORT_CURRENTS];
};

#endif
