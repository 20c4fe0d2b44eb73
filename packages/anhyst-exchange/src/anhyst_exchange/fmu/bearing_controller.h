/* SPDX-License-Identifier: Apache-2.0 */
/* The compiled position controller, with the interface of a simulated loop. */
#ifndef ANHYST_BEARING_CONTROLLER_H
#define ANHYST_BEARING_CONTROLLER_H

#include "anhyst_plant/controller.h"

/* Runs one tick of an anhyst_loop_controller; self is the anhyst_position_q31. */
void anhyst_bearing_controller_tick(void *self, const anhyst_loop_sample *sample,
                                    anhyst_loop_answer *answer);

#endif
