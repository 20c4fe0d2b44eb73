/* SPDX-License-Identifier: Apache-2.0 */

void anhyst_position_adapter_tick_x(void *self, const anhyst_loop_sample *sample,
                                    anhyst_loop_answer *answer)
{
  const anhyst_position_adapter_x *adapter = self;
  const anhyst_position_scales *scales = &adapter->scales;
  anhyst_position_sample_x in;
  anhyst_position_answer_x out;
  in.dropped = isnan(sample->head[0]) ? 1U : 0U;
  in.position = ANHYST_NAME(to_code)(scales->gap_middle - sample->head[0], scales->position);
  in.target = ANHYST_NAME(to_code)(scales->gap_middle - sample->target[0], scales->position);
  in.load = ANHYST_NAME(to_code)(sample->load[0], scales->load);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    const int there = i < sample->magnets;
    in.current[i] = ANHYST_NAME(current_to_code)(there ? sample->current[i] : 0.0, scales->current);
    in.flux[i] = ANHYST_NAME(flux_to_code)(there ? sample->flux[i] : (double)NAN, scales->flux);
  }
  in.command = sample->command > UINT16_MAX ? UINT16_MAX : (uint16_t)sample->command;
  anhyst_position_tick_x(adapter->position, &in, &out);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS && i < sample->magnets; i++) {
    answer->current[i] = ANHYST_NAME(from_code)(out.current[i], scales->current);
  }
  answer->reference[0] =
      scales->gap_middle - ANHYST_NAME(from_code)(out.reference, scales->position);
  answer->demand[0] = ANHYST_NAME(from_code)(out.demand, scales->demand);
  answer->state = out.state;
  answer->flags = out.flags;
}
