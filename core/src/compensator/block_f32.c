/* SPDX-License-Identifier: Apache-2.0 */
/* The check of a block in single precision, made from generic/block.h. */
#include "formats/f32.h"

#include "generic/block_real.h"
#include "generic/block.h"

anhyst_status anhyst_block_check_f32(const anhyst_kernel_f32 *kernel, const float *words,
                                     uint32_t capacity)
{
  return check_block(kernel, words, capacity);
}

uint16_t anhyst_block_misfit_f32(const float *words, const float *scales)
{
  return find_scale_mismatch(words, scales);
}
