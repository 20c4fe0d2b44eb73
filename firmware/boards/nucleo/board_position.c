/* SPDX-License-Identifier: Apache-2.0 */
/* Limits of the magnetic bearing on a Nucleo for a position controller. Range and speed limits of
   the position come from the controller that anhyst compile wrote. */
#include "boards/actuator_position.h"
#include "nucleo.h"

/* An encoder may keep its code while nothing moves. A levitated armature does not keep its code for
   2 ms after demanded force and current changed by a tenth of full scale. */
static const app_limits limits = {
    .current = {-PORT_ONE / 10, PORT_ONE / 10 * 11, PORT_ONE / 2, 0},
    .stuck_current = INT32_MAX / 10,
    .stuck_demand = INT32_MAX / 10,
    .still_ticks = ACTUATOR_CONTROLLER_RATE_HZ / 500U,
    .max_implausible_samples = 3,
    .missed_ticks = 2,
    .heartbeat_ms = 500,
    .has_current_sensor = 1,
};

const app_board nucleo_board = ACTUATOR_BOARD(ACTUATOR_CONTROLLER_RATE_HZ, &limits, &actuator_plan);
