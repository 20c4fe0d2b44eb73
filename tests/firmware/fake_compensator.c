/* SPDX-License-Identifier: Apache-2.0 */
#include "fake_compensator.h"

#include <string.h>

fake_calls fake;

const anhyst_kernel fake_kernel = {
    ANHYST_KIND_SIMPLIFIED, NULL, NULL, NULL, NULL, NULL, NULL, NULL};

void fake_block(int16_t *words, uint16_t length, uint16_t generation)
{
  for (uint16_t i = 0; i < length; i++) {
    words[i] = (int16_t)(7 * i);
  }
  words[ANHYST_WORD_MAGIC] = ANHYST_BLOCK_MAGIC_LOW;
  words[ANHYST_WORD_LAYOUT] = ANHYST_BLOCK_LAYOUT;
  words[ANHYST_WORD_KIND] = ANHYST_KIND_SIMPLIFIED;
  words[ANHYST_WORD_LENGTH] = (int16_t)length;
  words[ANHYST_WORD_GENERATION] = (int16_t)generation;
  words[ANHYST_WORD_MODEL] = 0x1234;
  words[ANHYST_WORD_MODEL + 1] = 0x5678;
  words[FAKE_EXTRA_CURRENT] = 0;
  words[ANHYST_WORD_CONDITION_CYCLES] = FAKE_CYCLES;
  words[ANHYST_WORD_CONDITION_TICKS] = FAKE_CYCLE_TICKS;
}

anhyst_status anhyst_block_check(const anhyst_kernel *kernel, const int16_t *words,
                                 uint16_t capacity)
{
  const int valid = words[ANHYST_WORD_MAGIC] == ANHYST_BLOCK_MAGIC_LOW &&
                    words[ANHYST_WORD_KIND] == (int16_t)kernel->kind &&
                    words[ANHYST_WORD_LENGTH] <= (int16_t)capacity;
  return valid ? ANHYST_OK : ANHYST_BAD_PARAMETER;
}

uint16_t anhyst_block_misfit(const int16_t *words, const int16_t *scales)
{
  const int same =
      memcmp(words + ANHYST_WORD_SCALE_DEMAND, scales, sizeof(int16_t) * ANHYST_SCALE_WORDS) == 0;
  return same ? 0 : ANHYST_WORD_SCALE_DEMAND;
}

anhyst_status anhyst_compensator_init_sized(anhyst_compensator *c, size_t size,
                                            const anhyst_kernel *kernel, const int16_t *words,
                                            uint16_t capacity)
{
  const anhyst_compensator fresh = {0};
  if (size != sizeof *c || anhyst_block_check(kernel, words, capacity) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->kernel = kernel;
  c->words = words;
  return ANHYST_OK;
}

void anhyst_compensator_demagnetise(anhyst_compensator *c)
{
  const anhyst_memory demagnetised = {{0, 0, 0, 0, 0}};
  c->memory = demagnetised;
  c->stage = ANHYST_STAGE_UNKNOWN;
}

void anhyst_compensator_swap(anhyst_compensator *c, const int16_t *words) { c->words = words; }

int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap)
{
  fake.solves++;
  fake.solved_gap = gap;
  c->flags = 0;
  if (demand < 0) {
    c->flags = ANHYST_DEMAND_LIMITED;
  }
  c->current = demand / 2 + (int32_t)c->words[FAKE_EXTRA_CURRENT] * 65536;
  return c->current;
}

void anhyst_compensator_commit_q31(anhyst_compensator *c, int32_t applied, int32_t gap)
{
  fake.commits++;
  fake.committed = applied;
  fake.committed_gap = gap;
  c->memory.number[0] = applied / 2;
  c->flux_applied = applied / 4;
}

int32_t anhyst_compensator_output_q31(const anhyst_compensator *c) { return c->flux_applied * 3; }

int32_t anhyst_conditioning_length(const anhyst_compensator *c)
{
  return (int32_t)c->words[ANHYST_WORD_CONDITION_CYCLES] * c->words[ANHYST_WORD_CONDITION_TICKS];
}

int32_t anhyst_conditioning_q31(const anhyst_compensator *c, int32_t tick)
{
  return tick < anhyst_conditioning_length(c) ? (tick + 1) * FAKE_CONDITION_STEP : 0;
}
