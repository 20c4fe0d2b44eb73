/* SPDX-License-Identifier: Apache-2.0 */
/* Limits of a virtual magnetic bearing for a position controller. Range and speed limits of the
   position come from the controller that anhyst compile wrote. */
#include "boards/actuator_position.h"
#include "lockstep.h"

/* An encoder may keep its code while nothing moves. A levitated armature does not keep its code for
   2 ms after demanded force and current changed by a twentieth of full scale. */
static const app_limits limits = {
    .current = {-PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, 0},
    .stuck_current = INT32_MAX / 20,
    .stuck_demand = INT32_MAX / 20,
    .still_ticks = ACTUATOR_CONTROLLER_RATE_HZ / 500U,
    .max_implausible_samples = 3,
    .missed_ticks = 2,
    .heartbeat_ms = 500,
    .has_current_sensor = 1,
};

const app_board lockstep_board =
    ACTUATOR_BOARD(ACTUATOR_CONTROLLER_RATE_HZ, &limits, &actuator_plan);
