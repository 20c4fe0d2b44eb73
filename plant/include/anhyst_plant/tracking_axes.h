/* SPDX-License-Identifier: Apache-2.0 */
/* The product's controllers of a body of several coordinates as a loop sees them. The plant's heads
   are the gap sensors, one a magnet, and then the position heads that the pose is found from. */
#ifndef ANHYST_PLANT_TRACKING_AXES_H
#define ANHYST_PLANT_TRACKING_AXES_H

#include "anhyst/control/axes.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_TRACKING_AXES_HEADS 32 /* position heads behind an adapter at most */

/* `at`: heads rows of axes, what each reads of a pose. In single precision heads are counted from
   the target before they are rounded; in double precision nobody looks at it. */
typedef struct {
  anhyst_axes_f64 axes;
  const double *at;
} anhyst_tracking_axes_f64;

typedef struct {
  anhyst_axes_f32 axes;
  const double *at;
} anhyst_tracking_axes_f32;

/* As the tick of an anhyst_loop_controller whose self is the adapter. target is the wanted pose,
   load the wrench that is fed forward. */
void anhyst_tracking_axes_tick_f64(void *self, const anhyst_loop_sample *sample,
                                   anhyst_loop_answer *answer);
void anhyst_tracking_axes_tick_f32(void *self, const anhyst_loop_sample *sample,
                                   anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
