/* SPDX-License-Identifier: Apache-2.0 */
/* The position controller of the actuator that a program is built around, see actuator.h. Not
   called after its contents: an actuator without a name has a file actuator_controller.h. */
#ifndef ANHYST_ACTUATOR_POSITION_H
#define ANHYST_ACTUATOR_POSITION_H

#include "boards/actuator.h"
#include "position/position.h"

#include ACTUATOR_FILE(ACTUATOR_JOIN(ACTUATOR_NAME, _controller).h)

#define ACTUATOR_CONTROLLER_LIMITS ACTUATOR_JOIN(ACTUATOR_NAME, _controller_limits)
#define ACTUATOR_CONTROLLER_SETTINGS ACTUATOR_JOIN(ACTUATOR_NAME, _controller_settings)

#ifndef ACTUATOR_CONTROLLER_MAGNETS /* see actuator.h */
#define ACTUATOR_CONTROLLER_MAGNETS ACTUATOR_JOIN(ACTUATOR_MACRO, _CONTROLLER_MAGNETS)
#define ACTUATOR_CONTROLLER_RATE_HZ ACTUATOR_JOIN(ACTUATOR_MACRO, _CONTROLLER_RATE_HZ)
#endif

static const app_plan actuator_plan = {
    .limits = &ACTUATOR_CONTROLLER_LIMITS,
    .settings = &ACTUATOR_CONTROLLER_SETTINGS,
    .magnets = ACTUATOR_CONTROLLER_MAGNETS,
};

#endif
