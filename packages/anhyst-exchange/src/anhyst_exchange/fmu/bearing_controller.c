/* SPDX-License-Identifier: Apache-2.0 */
/* This file is compiled separately from the plant, because both define the state of a hysteresis
 * law differently. */
#include "bearing_controller.h"

#include "anhyst_plant/position.h"
#include "controller_numbers.h"

void anhyst_bearing_controller_tick(void *self, const anhyst_loop_sample *sample,
                                    anhyst_loop_answer *answer)
{
  anhyst_position_adapter_q31 adapter = {(anhyst_position_q31 *)self, CONTROLLER_SCALES};
  anhyst_position_adapter_tick_q31(&adapter, sample, answer);
}
