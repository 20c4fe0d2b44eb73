/* SPDX-License-Identifier: Apache-2.0 */

void ANHYST_NAME(anhyst_tracking_adapter_tick)(void *self, const anhyst_loop_sample *sample,
                                               anhyst_loop_answer *answer)
{
  const ANHYST_NAME(anhyst_tracking_adapter) *adapter = self;
  const anhyst_tracking_scales *scales = &adapter->scales;
  ANHYST_REAL gap[ANHYST_TRACKING_MOST_DRIVES];
  ANHYST_REAL flux[ANHYST_TRACKING_MOST_DRIVES];
  ANHYST_REAL current[ANHYST_TRACKING_MOST_DRIVES];
  ANHYST_NAME(anhyst_tracking_sample) in;
  ANHYST_NAME(anhyst_tracking_answer) out;
  for (int i = 0; i < adapter->tracking->drives; i++) {
    const double at = i % 2 == 0 ? sample->head[0] : scales->gap_total - sample->head[0];
    gap[i] = ANHYST_NAME(gap_code)(at, scales->gap_low, scales->gap_high);
    flux[i] = ANHYST_NAME(flux)(sample->flux[i], scales->flux);
  }
  in.error = ANHYST_NAME(code)(sample->position[0] - sample->target[0], scales->error);
  in.forward = ANHYST_NAME(code)(sample->load[0], scales->forward);
  in.gap = gap;
  in.flux = flux;
  out.current = current;
  ANHYST_NAME(anhyst_tracking_tick)(adapter->tracking, &in, &out);
  for (int i = 0; i < adapter->tracking->drives; i++) {
    answer->current[i] = ANHYST_NAME(value)(current[i], scales->current);
  }
  answer->reference[0] = sample->target[0];
  answer->demand[0] = ANHYST_NAME(value)(out.demand, scales->demand);
}
