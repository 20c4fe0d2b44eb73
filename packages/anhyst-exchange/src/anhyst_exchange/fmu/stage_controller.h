/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a stage as a loop sees it. */
#ifndef ANHYST_STAGE_CONTROLLER_H
#define ANHYST_STAGE_CONTROLLER_H

#include "anhyst_plant/controller.h"
#include "stage_numbers.h"

/* Force controllers and law, as stage_controller.c alone knows them; no pointer in it must hold. */
typedef double anhyst_stage_controller[768 + 320 * STAGE_DRIVES];

/* At rest, the irons demagnetised. 0, or -1 for damaged parameters. */
int anhyst_stage_controller_start(anhyst_stage_controller controller);

/* As the tick of an anhyst_loop_controller; self is the anhyst_stage_controller. */
void anhyst_stage_controller_tick(void *self, const anhyst_loop_sample *sample,
                                  anhyst_loop_answer *answer);

#endif
