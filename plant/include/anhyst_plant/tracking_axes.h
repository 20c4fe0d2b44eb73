/* SPDX-License-Identifier: Apache-2.0 */
/* The product's controller of a body of several coordinates as a loop sees it. The plant's heads
   are the gap sensors, one a magnet, and then the position heads that the pose is found from. */
#ifndef ANHYST_PLANT_TRACKING_AXES_H
#define ANHYST_PLANT_TRACKING_AXES_H

#include "anhyst/control/axes.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* As the tick of an anhyst_loop_controller whose self is the anhyst_axes. target is the wanted
   pose, load the wrench that is fed forward. */
void anhyst_tracking_axes_tick(void *self, const anhyst_loop_sample *sample,
                               anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
