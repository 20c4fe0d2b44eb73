/* SPDX-License-Identifier: Apache-2.0 */
/* The check of a block in fixed point, made from generic/block.h. */
#include "formats/block_fixed.h"
#include "generic/block.h"

anhyst_status anhyst_block_check(const anhyst_kernel *kernel, const int16_t *words,
                                 uint16_t capacity)
{
  return check_block(kernel, words, capacity);
}

uint16_t anhyst_block_misfit(const int16_t *words, const int16_t *scales)
{
  return find_scale_mismatch(words, scales);
}
