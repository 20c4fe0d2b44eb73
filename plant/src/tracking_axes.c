/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/tracking_axes.h"

void anhyst_tracking_axes_tick(void *self, const anhyst_loop_sample *sample,
                               anhyst_loop_answer *answer)
{
  anhyst_axes *controller = self;
  const int drives = (int)controller->settings->layout.drives;
  const anhyst_axes_sample in = {sample->head + drives, sample->target, sample->load, sample->head,
                                 sample->flux};
  anhyst_axes_answer out = {answer->current, answer->demand, 0};
  int k;
  anhyst_axes_tick(controller, &in, &out);
  answer->flags = out.flags;
  for (k = 0; k < sample->coordinates; k++) {
    answer->reference[k] = sample->target[k];
  }
}
