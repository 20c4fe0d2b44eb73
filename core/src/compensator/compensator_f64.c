/* SPDX-License-Identifier: Apache-2.0 */
/* The compensator in double precision, made from generic/compensator.h. */
#include "formats/f64.h"

#include "generic/compensator_real.h"

#include "generic/compensator.h"

anhyst_status anhyst_compensator_init_sized_f64(anhyst_compensator_f64 *c, size_t size,
                                                const anhyst_kernel_f64 *kernel,
                                                const double *words, uint32_t capacity)
{
  if (size != sizeof *c) {
    return ANHYST_BAD_SIZE;
  }
  const anhyst_status status = anhyst_block_check_f64(kernel, words, capacity);
  if (status == ANHYST_OK) {
    init_state(c, kernel, words);
  }
  return status;
}

void anhyst_compensator_demagnetise_f64(anhyst_compensator_f64 *c) { demagnetise(c); }

void anhyst_compensator_swap_f64(anhyst_compensator_f64 *c, const double *words)
{
  swap_block(c, words);
}

double anhyst_compensator_solve_f64(anhyst_compensator_f64 *c, double demand, double gap)
{
  solve_demand(c, demand * c->per_demand, gap);
  return current_in_units(c);
}

void anhyst_compensator_commit_f64(anhyst_compensator_f64 *c, double applied, double gap)
{
  commit_current(c, applied == current_in_units(c) ? c->current : applied * c->per_current, gap);
}

double anhyst_compensator_output_f64(const anhyst_compensator_f64 *c)
{
  return model_output(c) * c->words[ANHYST_WORD_SCALE_DEMAND];
}

int32_t anhyst_conditioning_length_f64(const anhyst_compensator_f64 *c)
{
  return conditioning_ticks(c);
}

double anhyst_conditioning_f64(const anhyst_compensator_f64 *c, int32_t tick)
{
  return conditioning_word(c, tick) * c->words[ANHYST_WORD_SCALE_CURRENT];
}
