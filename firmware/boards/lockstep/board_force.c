/* SPDX-License-Identifier: Apache-2.0 */
/* Limits of a virtual magnet for a force controller. */
#include <stddef.h>

#include "boards/actuator.h"
#include "lockstep.h"

/* A virtual plant has noise like a real plant: a code that repeats for 256 ticks while the current
   moves by a twentieth of full scale is a fault. Full-scale steps of force and current in one tick
   are plausible. */
static const app_limits limits = {
    .gap = {-PORT_ONE / 20, PORT_ONE / 20 * 21, PORT_ONE / 20, 256},
    .force = {-PORT_ONE / 4, PORT_ONE / 4 * 5, PORT_ONE, 256},
    .current = {-PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, 256},
    .current_low = INT32_MIN,
    .current_high = INT32_MAX,
    .stuck_current = INT32_MAX / 20,
    .max_implausible_samples = 3,
    .missed_ticks = 2,
    .selftest_ticks = 16,
    .ramp_ms = 20,
    .heartbeat_ms = 500,
    .has_current_sensor = 1,
};

const app_board lockstep_board = ACTUATOR_BOARD(ACTUATOR_RATE_HZ, &limits, NULL);
