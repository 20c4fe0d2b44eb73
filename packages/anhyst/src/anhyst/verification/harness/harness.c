/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the code under test with random inputs or golden vectors, and hashes every output. The same
 * source runs on every target. The random generator uses unsigned 32-bit arithmetic only, so that
 * all targets get the same inputs. The code does not depend on the width of int. */
#include "harness.h"

#include "anhyst/numeric/status.h"

volatile harness_box_layout harness_box;

static uint32_t state;

uint32_t harness_draw(void)
{
  uint32_t x = state;
  x ^= x << 13;
  x ^= x >> 17;
  x ^= x << 5;
  state = x;
  return x;
}

void harness_add_to_hash(uint32_t word)
{
  uint32_t hash = (harness_box.hash ^ word) * 16777619U;
  harness_box.hash = hash ^ (hash >> 15);
}

void harness_measured(uint16_t section, uint32_t elapsed)
{
  volatile harness_section *s = &harness_box.sections[section];
  s->count++;
  if (elapsed < s->least) {
    s->least = elapsed;
  }
  if (elapsed > s->most) {
    s->most = elapsed;
    s->most_at = harness_box.step;
  }
  s->sum_low += elapsed;
  if (s->sum_low < elapsed) {
    s->sum_high++;
  }
}

static void run_step(void)
{
  uint32_t record[HARNESS_RECORD_WORDS];
  const uint32_t step = harness_box.step;
  const uint32_t since = step - harness_box.first_checkpoint_step;
  const uint32_t place = step - harness_box.first_window_step;
  if (step >= harness_box.first_checkpoint_step && since % harness_box.checkpoint_stride == 0 &&
      since / harness_box.checkpoint_stride < HARNESS_CHECKPOINTS) {
    harness_box.checkpoints[since / harness_box.checkpoint_stride] = harness_box.hash;
  }
  subject_step(record);
  for (uint32_t i = 0; i < HARNESS_RECORD_WORDS; i++) {
    harness_add_to_hash(record[i]);
    if (step >= harness_box.first_window_step && place < HARNESS_WINDOW) {
      harness_box.window[place][i] = record[i];
    }
  }
  harness_box.step = step + 1;
}

static void start(void)
{
  for (uint32_t i = 0; i < HARNESS_SECTIONS; i++) {
    harness_box.sections[i].count = 0;
    harness_box.sections[i].least = 0xFFFFFFFFU;
    harness_box.sections[i].most = 0;
    harness_box.sections[i].most_at = 0;
    harness_box.sections[i].sum_low = 0;
    harness_box.sections[i].sum_high = 0;
  }
  harness_box.box_words = sizeof harness_box / sizeof(uint32_t);
  harness_box.stack_bytes = 0;
  harness_box.step = 0;
  harness_box.hash = 2166136261U;
  state = harness_box.seed;
  subject_start();
  for (uint16_t i = 0; i < 4; i++) {
    harness_clock_start();
    harness_measured(HARNESS_EMPTY, harness_clock_stop());
  }
  if (harness_box.status == ANHYST_OK) {
    subject_fold_start();
  }
}

/* Returns 0 if the code under test did not start, because no step may run then. */
static uint32_t steps_to_run(void)
{
  return harness_box.status == ANHYST_OK ? harness_box.steps : 0;
}

static void measure_stack(void)
{
  for (uint32_t i = 0; i < steps_to_run(); i++) {
    subject_draw(harness_box.step);
    const uint32_t used = subject_stack();
    if (used > harness_box.stack_bytes) {
      harness_box.stack_bytes = used;
    }
    harness_box.step++;
  }
}

static void run_random(void)
{
  for (uint32_t i = 0; i < steps_to_run(); i++) {
    subject_draw(harness_box.step);
    run_step();
  }
}

/* The window contains inputs on entry, and inputs and outputs on return. */
static void run_vectors(void)
{
  harness_box.first_window_step = harness_box.step;
  for (uint32_t i = 0; i < steps_to_run() && i < HARNESS_WINDOW; i++) {
    subject_read(harness_box.window[i]);
    run_step();
  }
}

int harness_main(void)
{
  for (;;) {
    harness_wait();
    switch (harness_box.mode) {
    case HARNESS_START:
      start();
      break;
    case HARNESS_RANDOM:
      run_random();
      break;
    case HARNESS_VECTORS:
      run_vectors();
      break;
    case HARNESS_STACK:
      measure_stack();
      break;
    default:
      return 0;
    }
  }
}
