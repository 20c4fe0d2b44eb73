/* SPDX-License-Identifier: Apache-2.0 */
/* The check of a block in double precision, made from generic/block.h. */
#include "formats/f64.h"

#include "generic/block_real.h"
#include "generic/block.h"

anhyst_status anhyst_block_check_f64(const anhyst_kernel_f64 *kernel, const double *words,
                                     uint32_t capacity)
{
  return check_block(kernel, words, capacity);
}

uint16_t anhyst_block_misfit_f64(const double *words, const double *scales)
{
  return find_scale_mismatch(words, scales);
}
