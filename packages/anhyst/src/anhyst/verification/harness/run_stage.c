/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the whole controller of a stage in the harness, tick by tick. STAGE(x) forms the names of
 * its types and functions, and COUNT(x) those of its macros. */
#define PAINTED_BYTES 4096U
#include STAGE_HEADER
#include "steps.h"

/* Inputs and outputs of the controller in a tick, as signals and as words. */
typedef union {
  struct {
    STAGE(_sample) in;
    STAGE(_answer) out;
  } signals;
  uint32_t word[HARNESS_RECORD_WORDS];
} tick_of;

typedef char same_size[sizeof(tick_of) == 4 * HARNESS_RECORD_WORDS ? 1 : -1];

static STAGE() controller;
static tick_of now;

#ifdef STAGE_CODES

/* Returns a uniform random number between -most and most. */
static int32_t draw(int32_t most) { return (int32_t)((int64_t)draw_q30(0) * most / Q30_ONE); }

static void start_drawing(STAGE(_sample) * in)
{
  const STAGE(_sample) rest = {.command = 0};
  *in = rest;
}

/* Generates a sample. The wrench is near the weight of the body, or temporarily beyond the largest
 * wrench. Occasionally a gap is implausible. */
static void draw_sample(uint32_t step, STAGE(_sample) * in)
{
  static const int32_t rest[COUNT(AXES)] = {0};
  STAGE(_feed)(rest, in->forward);
  for (int i = 0; i < COUNT(HEADS); i++) {
    in->head[i] = draw(harness_draw() % 64U == 0U ? 4194304 : 262144);
  }
  for (int k = 0; k < COUNT(AXES); k++) {
    const int32_t most = step % 1024U < 128U ? Q30_ONE : Q30_ONE / 64;
    in->forward[k] = anhyst_add_q31(in->forward[k], draw(most));
  }
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    const int32_t wide = harness_draw() % 256U == 0U ? Q30_ONE : Q30_ONE / 128;
    in->gap[i] = anhyst_add_q31(in->gap[i], draw(wide));
  }
}

#else

static float force[COUNT(MAGNETS)]; /* forces whose wrench is fed forward, relative to the largest
                                     */

/* Returns a uniform random number in -1..1. */
static float draw(void) { return (float)draw_q30(0) / (float)Q30_ONE; }

static void start_drawing(STAGE(_sample) * in)
{
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    force[i] = 0.0F;
    in->gap[i] = COUNT(GAP_LOW_M);
  }
}

/* Generates a sample. The forces walk, or temporarily jump over the full range. Occasionally a gap
 * is implausible. */
static void draw_sample(uint32_t step, STAGE(_sample) * in)
{
  const float *pull = STAGE(_settings).layout.pull;
  const float span = COUNT(GAP_HIGH_M) - COUNT(GAP_LOW_M);
  for (int i = 0; i < COUNT(HEADS); i++) {
    in->head[i] = draw() * (harness_draw() % 64U == 0U ? 2e-6F : 1e-7F);
  }
  for (int k = 0; k < COUNT(AXES); k++) {
    in->forward[k] = 0.0F;
  }
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    const float walked = force[i] + draw() / 64.0F;
    force[i] = step % 1024U < 128U ? draw() : walked;
    force[i] = force[i] > 0.0F && force[i] < 1.0F ? force[i] : 0.5F;
    in->gap[i] += span * draw() / 256.0F;
    if (harness_draw() % 256U == 0U) {
      in->gap[i] = COUNT(GAP_LOW_M) + span * 2.0F * draw();
    }
    for (int k = 0; k < COUNT(AXES); k++) {
      in->forward[k] += COUNT(FORCE_MAX_N) * force[i] * pull[i * COUNT(AXES) + k];
    }
  }
}

#endif

void subject_start(void)
{
  harness_box.state_bytes = sizeof controller;
  harness_box.control_bytes = 0;
  harness_box.words = 0;
  start_drawing(&now.signals.in);
  harness_box.status = (uint32_t)(int32_t)STAGE(_init)(&controller);
}

void subject_fold_start(void) { harness_add_to_hash(STAGE(_settings).layout.drives); }

void subject_draw(uint32_t step)
{
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    now.signals.in.read[i] = now.signals.out.current[i];
  }
  draw_sample(step, &now.signals.in);
}

void subject_read(const volatile uint32_t *row)
{
  for (uint32_t i = 0; i < HARNESS_RECORD_WORDS; i++) {
    now.word[i] = row[i];
  }
}

void subject_step(uint32_t *record)
{
  harness_clock_start();
  STAGE(_tick)(&controller, &now.signals.in, &now.signals.out);
  const uint32_t elapsed = harness_clock_stop();
  harness_measured(now.signals.out.flags != 0U ? HARNESS_RAMPS : HARNESS_CONTROLS, elapsed);
  harness_measured(HARNESS_TICK, elapsed);
  for (uint32_t i = 0; i < HARNESS_RECORD_WORDS; i++) {
    record[i] = now.word[i];
  }
}

/* Returns the bytes of stack that a tick uses, including its return address. */
uint32_t subject_stack(void)
{
  const uintptr_t top = harness_stack_pointer();
  const uintptr_t low = painted_from(top);
  paint(low, top);
  STAGE(_tick)(&controller, &now.signals.in, &now.signals.out);
  return (uint32_t)(top - deepest(low, top));
}
