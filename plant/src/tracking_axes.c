/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst_plant/tracking_axes.h"

static void refer(const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
{
  int k;
  for (k = 0; k < sample->coordinates; k++) {
    answer->reference[k] = sample->target[k];
  }
}

void anhyst_tracking_axes_tick_f64(void *self, const anhyst_loop_sample *sample,
                                   anhyst_loop_answer *answer)
{
  anhyst_axes_f64 *controller = &((anhyst_tracking_axes_f64 *)self)->axes;
  const int drives = (int)controller->settings->layout.drives;
  const anhyst_axes_sample_f64 in = {sample->head + drives, sample->target, sample->load,
                                     sample->head, sample->flux};
  anhyst_axes_answer_f64 out = {answer->current, answer->demand, 0};
  anhyst_axes_tick_f64(controller, &in, &out);
  answer->flags = out.flags;
  refer(sample, answer);
}

/* What a head reads less what it would read at the target. */
static float off_target(const anhyst_tracking_axes_f32 *controller,
                        const anhyst_loop_sample *sample, int head)
{
  const anhyst_axes_settings_f32 *settings = controller->axes.settings;
  const int axes = (int)settings->layout.axes;
  double off = sample->head[(int)settings->layout.drives + head];
  int k;
  for (k = 0; k < axes; k++) {
    off -= controller->at[head * axes + k] * sample->target[k];
  }
  return (float)off;
}

void anhyst_tracking_axes_tick_f32(void *self, const anhyst_loop_sample *sample,
                                   anhyst_loop_answer *answer)
{
  anhyst_tracking_axes_f32 *controller = self;
  const anhyst_axes_settings_f32 *settings = controller->axes.settings;
  const float target[ANHYST_WRENCH_AXES] = {0};
  float head[ANHYST_TRACKING_AXES_HEADS];
  float forward[ANHYST_WRENCH_AXES];
  float gap[ANHYST_WRENCH_DRIVES];
  float flux[ANHYST_WRENCH_DRIVES];
  float current[ANHYST_WRENCH_DRIVES];
  float demand[ANHYST_WRENCH_AXES];
  const anhyst_axes_sample_f32 in = {head, target, forward, gap, flux};
  anhyst_axes_answer_f32 out = {current, demand, 0};
  int i;
  for (i = 0; i < (int)settings->heads; i++) {
    head[i] = off_target(controller, sample, i);
  }
  for (i = 0; i < (int)settings->layout.axes; i++) {
    forward[i] = (float)sample->load[i];
  }
  for (i = 0; i < (int)settings->layout.drives; i++) {
    gap[i] = (float)sample->head[i];
    flux[i] = (float)sample->flux[i];
  }
  anhyst_axes_tick_f32(&controller->axes, &in, &out);
  for (i = 0; i < (int)settings->layout.drives; i++) {
    answer->current[i] = (double)current[i];
  }
  for (i = 0; i < (int)settings->layout.axes; i++) {
    answer->demand[i] = (double)demand[i];
  }
  answer->flags = out.flags;
  refer(sample, answer);
}
