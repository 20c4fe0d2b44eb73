/* SPDX-License-Identifier: Apache-2.0 */
/* The built-in actuator of a firmware. */
#ifndef BOARDS_ACTUATOR_H
#define BOARDS_ACTUATOR_H

#include "anhyst/actuator.h"

/* Initialiser of an app_board; the board supplies limits and plan (plan: NULL for a force body). */
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
