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

static void narrow(const double *values, float *found, int count)
{
  int i;
  for (i = 0; i < count; i++) {
    found[i] = (float)values[i];
  }
}

static void widen(const float *values, double *found, int count)
{
  int i;
  for (i = 0; i < count; i++) {
    found[i] = (double)values[i];
  }
}

void anhyst_tracking_axes_tick_f32(void *self, const anhyst_loop_sample *sample,
                                   anhyst_loop_answer *answer)
{
  anhyst_tracking_axes_f32 *controller = self;
  const int axes = (int)controller->axes.settings->layout.axes;
  const int drives = (int)controller->axes.settings->layout.drives;
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
  int k;
  for (i = 0; i < (int)controller->axes.settings->heads; i++) {
    double off = sample->head[drives + i];
    for (k = 0; k < axes; k++) {
      off -= controller->at[i * axes + k] * sample->target[k];
    }
    head[i] = (float)off;
  }
  narrow(sample->load, forward, axes);
  narrow(sample->head, gap, drives);
  narrow(sample->flux, flux, drives);
  anhyst_axes_tick_f32(&controller->axes, &in, &out);
  widen(current, answer->current, drives);
  widen(demand, answer->demand, axes);
  answer->flags = out.flags;
  refer(sample, answer);
}
