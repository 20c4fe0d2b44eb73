/* SPDX-License-Identifier: Apache-2.0 */
/* PID, allocation and force controllers as `anhyst simulate` runs them: the first two in double
 * precision, the others in fixed point or in double precision. The controllers are compiled
 * separately from the plant, which defines the state of a hysteresis law differently. */
#include "stage_controller.h"

#include <stddef.h>

#include "anhyst/compensator/force_coded_real.h"
#include "anhyst/compensator/force_corrected_real.h"
#include "anhyst/control/axes.h"
#include "anhyst_plant/axes.h"

/* Calibrated corrections of each magnet; without a calibration {1, 0, 1, 0}. */
static const anhyst_correction_f64 corrections[STAGE_DRIVES] = STAGE_CORRECTIONS;

/* The words of all different parameter blocks, and the position of the block of each drive. */
static const STAGE_WORD words[] = STAGE_WORDS;
static const struct {
  uint32_t first;
  uint16_t count;
} blocks[STAGE_DRIVES] = STAGE_BLOCKS;

#ifdef STAGE_CODES

/* Compensators in fixed point, and the physical values that the code 1.0 represents. */
static const anhyst_code_scales_f64 codes = STAGE_CODES;

typedef anhyst_force_controller_q31 force_controller;

#define INIT_FORCE anhyst_force_controller_init_compensator_q31
#define COMPENSATOR_METHOD anhyst_force_by_compensator_q31

#else

/* Compensators in double precision. */
typedef anhyst_force_controller_f64 force_controller;

#define INIT_FORCE anhyst_force_controller_init_compensator_f64
#define COMPENSATOR_METHOD anhyst_force_by_compensator_f64

#endif

static anhyst_status start_force(force_controller *force, int i)
{
  return INIT_FORCE(force, &STAGE_KERNEL, words + blocks[i].first, blocks[i].count);
}

/* Sets the pointers of a force controller, as at every tick. */
static void relink_force(force_controller *force, int i)
{
  force->method = &COMPENSATOR_METHOD;
  force->compensator.kernel = &STAGE_KERNEL;
  force->compensator.words = words + blocks[i].first;
}

static const anhyst_axes_settings_f64 settings = STAGE_SETTINGS;

static int start_law(anhyst_axes_f64 *law)
{
  return anhyst_axes_init_f64(law, &settings, NULL) == ANHYST_OK;
}

/* The gap sensors of the magnets come before the position heads, which are counted from the target.
 */
static void run_law(anhyst_axes_f64 *law, anhyst_force_controller_f64 *const *drive,
                    const anhyst_loop_sample *sample, anhyst_loop_answer *answer)
{
  static const double at[] = STAGE_AT;
  double head[STAGE_HEADS];
  const anhyst_axes_sample_f64 in = {.head = head,
                                     .forward = sample->load,
                                     .gap = sample->head,
                                     .flux = sample->flux,
                                     .current = sample->current,
                                     .command = (uint16_t)sample->command};
  anhyst_axes_answer_f64 out = {.current = answer->current, .demand = answer->demand};
  for (int i = 0; i < STAGE_HEADS; i++) {
    head[i] = sample->head[STAGE_DRIVES + i];
    for (int j = 0; j < settings.layout.axes; j++) {
      head[i] -= at[i * settings.layout.axes + j] * sample->target[j];
    }
  }
  law->settings = &settings;
  law->allocator.layout = &settings.layout;
  law->drive = drive;
  anhyst_axes_tick_f64(law, &in, &out);
  answer->flags = out.flags;
  answer->state = anhyst_axes_state_word(out.state, out.lost);
}

typedef struct {
  force_controller force[STAGE_DRIVES];
  anhyst_corrected_f64 corrected[STAGE_DRIVES];
  anhyst_axes_f64 law;
  /* The pointers below are set again at every tick. */
  anhyst_force_controller_f64 corrected_force[STAGE_DRIVES];
#ifdef STAGE_CODES
  anhyst_coded_f64 coded[STAGE_DRIVES];
  anhyst_force_controller_f64 in_si[STAGE_DRIVES];
#endif
} controller_of;

typedef char it_fits[sizeof(controller_of) <= sizeof(anhyst_stage_controller) ? 1 : -1];

int anhyst_stage_controller_start(anhyst_stage_controller controller)
{
  controller_of *now = (controller_of *)(void *)controller;
  int i;
  for (i = 0; i < STAGE_DRIVES; i++) {
    const anhyst_corrected_f64 rest = {corrections[i], NULL, 0.0, 0.0};
    now->corrected[i] = rest;
    if (start_force(&now->force[i], i) != ANHYST_OK) {
      return -1;
    }
  }
  return start_law(&now->law) ? 0 : -1;
}

void anhyst_stage_controller_tick(void *self, const anhyst_loop_sample *sample,
                                  anhyst_loop_answer *answer)
{
  controller_of *now = (controller_of *)self;
#ifdef STAGE_CODES
  anhyst_force_controller_f64 *in_si = now->in_si;
#else
  anhyst_force_controller_f64 *in_si = now->force;
#endif
  anhyst_force_controller_f64 *drive[STAGE_DRIVES];
  int i;
  for (i = 0; i < STAGE_DRIVES; i++) {
    const double root = now->corrected[i].root;
    const double previous_root = now->corrected[i].previous_root;
    relink_force(&now->force[i], i);
#ifdef STAGE_CODES
    (void)anhyst_force_controller_init_coded_f64(&in_si[i], &now->coded[i], &codes, &now->force[i]);
#endif
    (void)anhyst_force_controller_init_corrected_f64(&now->corrected_force[i], &now->corrected[i],
                                                     &corrections[i], &in_si[i]);
    now->corrected[i].root = root;
    now->corrected[i].previous_root = previous_root;
    drive[i] = &now->corrected_force[i];
  }
  run_law(&now->law, drive, sample, answer);
}
