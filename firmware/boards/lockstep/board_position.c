/* SPDX-License-Identifier: Apache-2.0 */
/* What a virtual bearing is to a controller of position. The range of the position and how fast it
   can move stand in the controller that anhyst compile wrote. */
#include "anhyst_controller.h"
#include "lockstep.h"
#include "position/flight.h"

/* An encoder may rest on one code as long as nothing moves; for 2 ms, while the current moves by a
   twentieth, an armature in the air does not. */
static const app_limits limits = {
    .current = {-PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, PORT_ONE / 4 * 5, 0},
    .stuck_current = INT32_MAX / 20,
    .still_ticks = ANHYST_CONTROLLER_RATE_HZ / 500U,
    .doubtful_ticks = 3,
    .missed_ticks = 2,
    .heartbeat_ms = 500,
};

static const app_plan plan = {
    .limits = &anhyst_controller_limits,
    .settings = &anhyst_controller_settings,
    .magnets = ANHYST_CONTROLLER_MAGNETS,
};

static app_body body;

const app_board lockstep_board = {
    .body = &body,
    .plan = &plan,
    .kernel = &ANHYST_KERNEL,
    .words = anhyst_parameters,
    .words_capacity = ANHYST_PARAMETERS_WORDS,
    .firmware = BOARD_FIRMWARE_VERSION,
    .rate = ANHYST_CONTROLLER_RATE_HZ,
    .limits = &limits,
};
