/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law in single precision. */
#include "formats/f32.h"

#include "generic/block_real.h"
#include "generic/cells_real.h"
#include "generic/cells_path.h"
#include "generic/cells_block.h"
#include "generic/cells.h"

#if ANHYST_MEMORIES > 1
#include "generic/solid.h"

static const anhyst_kernel_f32 kernel_solid;

static const anhyst_kernel_f32 *kernel_for_block(const entry *words)
{
  return layers_of(words) > 0 ? &kernel_solid : &anhyst_kernel_cells_f32;
}

static const anhyst_kernel_f32 kernel_solid = {ANHYST_KIND_CELLS,    solid_field,     solid_flux,
                                               is_cells_block_valid, solid_carry,     solid_keep,
                                               solid_start,          kernel_for_block};
#else
#define kernel_for_block 0
#endif

const anhyst_kernel_f32 anhyst_kernel_cells_f32 = {
    ANHYST_KIND_CELLS, cells_field, cells_flux,  is_cells_block_valid,
    cells_carry,       cells_keep,  cells_start, kernel_for_block};
