/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a stage, with the interface of a simulated loop. */
#ifndef ANHYST_STAGE_CONTROLLER_H
#define ANHYST_STAGE_CONTROLLER_H

#include "anhyst_plant/controller.h"
#include "stage_numbers.h"

/* Force controllers and control law. Only stage_controller.c knows their types; pointers in them
 * are set at every tick. */
typedef double anhyst_stage_controller[768 + 320 * STAGE_DRIVES];

/* Starts at rest with demagnetised iron. Returns 0, or -1 if parameters are damaged. */
int anhyst_stage_controller_start(anhyst_stage_controller controller);

/* Runs one tick of an anhyst_loop_controller; self is the anhyst_stage_controller. */
void anhyst_stage_controller_tick(void *self, const anhyst_loop_sample *sample,
                                  anhyst_loop_answer *answer);

#endif
