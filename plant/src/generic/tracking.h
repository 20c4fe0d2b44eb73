/* SPDX-License-Identifier: Apache-2.0 */

void anhyst_tracking_adapter_tick_x(void *self, const anhyst_loop_sample *sample,
                                    anhyst_loop_answer *answer)
{
  const anhyst_tracking_adapter_x *adapter = self;
  const anhyst_tracking_scales *scales = &adapter->scales;
  ANHYST_REAL gap[ANHYST_TRACKING_MOST_DRIVES];
  ANHYST_REAL flux[ANHYST_TRACKING_MOST_DRIVES];
  ANHYST_REAL current[ANHYST_TRACKING_MOST_DRIVES];
  anhyst_tracking_sample_x in;
  anhyst_tracking_answer_x out;
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
  anhyst_tracking_tick_x(adapter->tracking, &in, &out);
  for (int i = 0; i < adapter->tracking->drives; i++) {
    answer->current[i] = ANHYST_NAME(value)(current[i], scales->current);
  }
  answer->reference[0] = sample->target[0];
  answer->demand[0] = ANHYST_NAME(value)(out.demand, scales->demand);
}
