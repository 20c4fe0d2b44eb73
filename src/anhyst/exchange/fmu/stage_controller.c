/* SPDX-License-Identifier: Apache-2.0 */
/* PID, allocation and force controllers as `anhyst simulate` runs them: the first two in double
   precision, the others in fixed point. Apart from the plant: both have a memory of a law, each of
   its own kind. */
#include "stage_controller.h"

#include <stddef.h>

#include "anhyst/compensator/force_coded_real.h"
#include "anhyst_plant/tracking.h"
#include "stage_numbers.h"

typedef struct {
  anhyst_force_controller_q31 force[STAGE_DRIVES];
  anhyst_pid_state_f64 pid;
} controller_of;

typedef char it_fits[sizeof(controller_of) <= sizeof(anhyst_stage_controller) ? 1 : -1];

static const anhyst_tracking_settings_f64 settings = STAGE_SETTINGS;

int anhyst_stage_controller_start(anhyst_stage_controller controller)
{
  controller_of *now = (controller_of *)(void *)controller;
  const anhyst_pid_state_f64 rest = {{0.0, 0.0}};
  int i;
  for (i = 0; i < STAGE_DRIVES; i++) {
    if (anhyst_force_controller_init_compensator_q31(&now->force[i], &STAGE_KERNEL, stage_words,
                                                     sizeof stage_words / sizeof *stage_words) !=
        ANHYST_OK) {
      return -1;
    }
  }
  now->pid = rest;
  return 0;
}

void anhyst_stage_controller_tick(void *self, const anhyst_loop_sample *sample,
                                  anhyst_loop_answer *answer)
{
  controller_of *now = (controller_of *)self;
  anhyst_coded_f64 coded[STAGE_DRIVES];
  anhyst_force_controller_f64 in_si[STAGE_DRIVES];
  anhyst_force_controller_f64 *drive[STAGE_DRIVES];
  anhyst_tracking_f64 tracking = {&settings, drive, NULL, now->pid, STAGE_DRIVES};
  anhyst_tracking_adapter_f64 adapter = {&tracking, STAGE_SCALES, STAGE_GAP_TOTAL};
  const anhyst_tracking_scales *of = &adapter.scales;
  const anhyst_code_scales_f64 codes = {of->demand, of->current, of->flux, of->gap_low,
                                        of->gap_high};
  int i;
  for (i = 0; i < STAGE_DRIVES; i++) {
    now->force[i].method = &anhyst_force_by_compensator_q31;
    now->force[i].compensator.kernel = &STAGE_KERNEL;
    now->force[i].compensator.words = stage_words;
    (void)anhyst_force_controller_init_coded_f64(&in_si[i], &coded[i], &codes, &now->force[i]);
    drive[i] = &in_si[i];
  }
  anhyst_tracking_adapter_tick_f64(&adapter, sample, answer);
  now->pid = tracking.state;
}
