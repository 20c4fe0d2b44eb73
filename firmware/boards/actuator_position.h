/* SPDX-License-Identifier: Apache-2.0 */
/* Position controller of the built-in actuator; see actuator.h. The name actuator_controller.h
   would collide with the file of an actuator without a name. */
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
