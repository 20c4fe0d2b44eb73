/* SPDX-License-Identifier: Apache-2.0 */
/* The actuator that a firmware is built around, as its board describes it. */
#ifndef BOARDS_ACTUATOR_H
#define BOARDS_ACTUATOR_H

#include "anhyst/actuator.h"

/* What an app_board says, with limits and a plan (NULL of a body of force) of the board's own. */
#define ACTUATOR_BOARD(its_rate, its_limits, its_plan)                                             \
  {                                                                                                \
      .name = ACTUATOR_CALLED,                                                                     \
      .plan = (its_plan),                                                                          \
      .kernel = &ACTUATOR_KERNEL,                                                                  \
      .words = ACTUATOR_PARAMETERS,                                                                \
      .words_capacity = ACTUATOR_PARAMETERS_WORDS,                                                 \
      .scales = (const int16_t[ANHYST_SCALE_WORDS])ACTUATOR_SCALES,                                \
      .firmware = BOARD_FIRMWARE_VERSION,                                                          \
      .rate = (its_rate),                                                                          \
      .limits = (its_limits),                                                                      \
  }

#endif
