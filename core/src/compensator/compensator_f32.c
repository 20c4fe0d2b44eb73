/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in single precision, made from generic/compensator.h. */
#include "formats/f32.h"

#include "generic/compensator_real.h"

#include "generic/compensator.h"

anhyst_status anhyst_compensator_init_sized_f32(anhyst_compensator_f32 *c, size_t size,
                                                const anhyst_kernel_f32 *kernel, const float *words,
                                                uint32_t capacity)
{
  if (size != sizeof *c) {
    return ANHYST_BAD_SIZE;
  }
  const anhyst_status status = anhyst_block_check_f32(kernel, words, capacity);
  if (status == ANHYST_OK) {
    init_state(c, kernel, words);
  }
  return status;
}

void anhyst_compensator_demagnetise_f32(anhyst_compensator_f32 *c) { demagnetise(c); }

void anhyst_compensator_swap_f32(anhyst_compensator_f32 *c, const float *words)
{
  swap_block(c, words);
}

float anhyst_compensator_solve_f32(anhyst_compensator_f32 *c, float demand, float gap)
{
  solve_demand(c, demand * c->per_demand, gap);
  return current_in_units(c);
}

void anhyst_compensator_commit_f32(anhyst_compensator_f32 *c, float applied, float gap)
{
  commit_current(c, applied == current_in_units(c) ? c->current : applied * c->per_current, gap);
}

float anhyst_compensator_output_f32(const anhyst_compensator_f32 *c)
{
  return model_output(c) * c->words[ANHYST_WORD_SCALE_DEMAND];
}

int32_t anhyst_conditioning_length_f32(const anhyst_compensator_f32 *c)
{
  return conditioning_ticks(c);
}

float anhyst_conditioning_f32(const anhyst_compensator_f32 *c, int32_t tick)
{
  return conditioning_word(c, tick) * c->words[ANHYST_WORD_SCALE_CURRENT];
}
