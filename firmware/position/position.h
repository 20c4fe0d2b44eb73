/* SPDX-License-Identifier: Apache-2.0 */
/* The body of a control task that holds an armature in the air: position in, currents out, by the
   very controller that anhyst simulate runs (anhyst/control/position.h), with the limits and
   settings that anhyst compile wrote. anhyst/control/levitation.h says what each phase does. */
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

/* How long the position has been on one code although wanted force and current moved. */
typedef struct {
  int32_t code;   /* of the position */
  int32_t demand; /* force wanted when it was new, q31 */
  int32_t drive;  /* current driven when it was new, q31 */
  uint32_t ticks; /* since both have moved by stuck_demand and stuck_current of app_limits */
} app_stillness;

struct app_body {
  const app_board *board;
  anhyst_position_q31 position;
  anhyst_force_controller_q31 magnet[ANHYST_POSITION_MAGNETS];
  anhyst_position_answer_q31 answer;     /* of the last tick */
  anhyst_position_settings_q31 tuned[2]; /* with gains of the operator; one of them is free */
  int32_t target;                        /* position to go to */
  app_stillness still;
  app_current current[PORT_CURRENTS];
};

#endif
