/* SPDX-License-Identifier: Apache-2.0 */
/* What the harness runs: the whole controller of a stage, tick by tick. STAGE names its parts and
   COUNT its numbers. */
#define PAINTED_BYTES 4096U
#include STAGE_HEADER
#include "steps.h"

#define PHASE_STEPS 128U
#define WORDS(type) (sizeof(type) / sizeof(uint32_t))

/* A sample is its words, and so is an answer. */
typedef union {
  STAGE(_sample) signals;
  uint32_t word[WORDS(STAGE(_sample))];
} given;

typedef union {
  STAGE(_answer) signals;
  uint32_t word[WORDS(STAGE(_answer))];
} answered;

typedef char same_size[WORDS(given) + WORDS(answered) == (int)HARNESS_RECORD_WORDS ? 1 : -1];

static STAGE() controller;
static given in;
static float force[COUNT(MAGNETS)]; /* whose wrench is fed forward, of the largest */
static uint32_t way;                /* how forces and gaps go in this phase */

/* Uniform over -1..1. */
static float draw(void) { return (float)draw_q30(0) / (float)Q30_ONE; }

static float bounded(float a)
{
  if (!(a > 0.0F)) {
    return 0.0F;
  }
  return a < 1.0F ? a : 1.0F;
}

void subject_start(void)
{
  harness_box.state_bytes = sizeof controller;
  harness_box.control_bytes = 0;
  harness_box.words = 0;
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    force[i] = 0.0F;
    in.signals.gap[i] = COUNT(GAP_LOW_M);
  }
  harness_box.status = (uint32_t)(int32_t)STAGE(_init)(&controller);
}

/* Sizes are what of the settings is of one form on all targets. */
void subject_fold_start(void)
{
  harness_fold(STAGE(_settings).layout.axes);
  harness_fold(STAGE(_settings).layout.drives);
}

/* Forces walk or jump, some beyond what there is; now and then a gap is one that cannot be. */
void subject_draw(uint32_t step)
{
  const float *pull = STAGE(_settings).layout.pull;
  const float span = COUNT(GAP_HIGH_M) - COUNT(GAP_LOW_M);
  if (step % PHASE_STEPS == 0) {
    way = harness_draw() % 8U;
  }
  for (int k = 0; k < COUNT(AXES); k++) {
    in.signals.forward[k] = 0.0F;
  }
  for (int i = 0; i < COUNT(MAGNETS); i++) {
    const float drawn = draw();
    force[i] = way == 0U ? drawn : bounded(force[i] + drawn / 64.0F);
    in.signals.gap[i] += span * draw() / 256.0F;
    if (harness_draw() % 256U == 0U) {
      in.signals.gap[i] = COUNT(GAP_LOW_M) + span * 2.0F * draw();
    }
    for (int k = 0; k < COUNT(AXES); k++) {
      in.signals.forward[k] += COUNT(FORCE_MAX_N) * force[i] * pull[i * COUNT(AXES) + k];
    }
  }
  for (int i = 0; i < COUNT(HEADS); i++) {
    in.signals.head[i] = draw() * (harness_draw() % 64U == 0U ? 1e-5F : 1e-7F);
  }
}

void subject_read(const volatile uint32_t *row)
{
  for (uint32_t i = 0; i < WORDS(given); i++) {
    in.word[i] = row[i];
  }
}

void subject_step(uint32_t *record)
{
  answered out;
  harness_clock_start();
  STAGE(_tick)(&controller, &in.signals, &out.signals);
  const uint32_t elapsed = harness_clock_stop();
  harness_measured(out.signals.flags != 0U ? HARNESS_RAMPS : HARNESS_CONTROLS, elapsed);
  harness_measured(HARNESS_TICK, elapsed);
  for (uint32_t i = 0; i < WORDS(given); i++) {
    record[i] = in.word[i];
  }
  for (uint32_t i = 0; i < WORDS(answered); i++) {
    record[WORDS(given) + i] = out.word[i];
  }
}

/* Bytes of stack that a tick uses, its return address included. */
uint32_t subject_stack(void)
{
  answered out;
  const uintptr_t top = harness_stack_pointer();
  const uintptr_t low = painted_from(top);
  paint(low, top);
  STAGE(_tick)(&controller, &in.signals, &out.signals);
  return (uint32_t)(top - deepest(low, top));
}
