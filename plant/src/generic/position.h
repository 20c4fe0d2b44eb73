/* SPDX-License-Identifier: Apache-2.0 */

void ANHYST_NAME(anhyst_position_adapter_tick)(void *self, const anhyst_loop_sample *sample,
                                               anhyst_loop_answer *answer)
{
  const ANHYST_NAME(anhyst_position_adapter) *adapter = self;
  const anhyst_position_scales *scales = &adapter->scales;
  ANHYST_NAME(anhyst_position_sample) in;
  ANHYST_NAME(anhyst_position_answer) out;
  in.dropped = isnan(sample->gap) ? 1U : 0U;
  in.position = ANHYST_NAME(code)(scales->gap_middle - sample->gap, scales->position);
  in.target = ANHYST_NAME(code)(scales->gap_middle - sample->target, scales->position);
  in.load = ANHYST_NAME(code)(sample->load, scales->load);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    in.current[i] = ANHYST_NAME(measured)(sample->current[i], scales->current);
    in.flux[i] = ANHYST_NAME(flux)(sample->flux[i], scales->flux);
  }
  in.command = sample->command > UINT16_MAX ? UINT16_MAX : (uint16_t)sample->command;
  ANHYST_NAME(anhyst_position_tick)(adapter->position, &in, &out);
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    answer->current[i] = ANHYST_NAME(value)(out.current[i], scales->current);
  }
  answer->reference = scales->gap_middle - ANHYST_NAME(value)(out.reference, scales->position);
  answer->demand = ANHYST_NAME(value)(out.demand, scales->demand);
  answer->state = out.state;
  answer->flags = out.flags;
}
