/* SPDX-License-Identifier: Apache-2.0 */
/* Limits of the magnet on a Nucleo for a force controller. */
#include <stddef.h>

#include "boards/actuator.h"
#include "nucleo.h"
#include "port/port.h"

static const app_limits limits = {
    .gap = {-PORT_ONE / 20, PORT_ONE / 20 * 21, PORT_ONE / 20, 256},
    .force = {-PORT_ONE / 10, PORT_ONE / 10 * 11, PORT_ONE / 2, 256},
    .current = {-PORT_ONE / 10, PORT_ONE / 10 * 11, PORT_ONE / 2, 256},
    .current_low = 0,
    .current_high = INT32_MAX,
    .stuck_current = INT32_MAX / 10,
    .max_implausible_samples = 3,
    .missed_ticks = 2,
    .selftest_ticks = 100,
    .ramp_ms = 20,
    .heartbeat_ms = 500,
    .has_current_sensor = 1,
};

const app_board nucleo_board = ACTUATOR_BOARD(ACTUATOR_RATE_HZ, &limits, NULL);
