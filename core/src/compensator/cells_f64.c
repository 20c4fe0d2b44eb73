/* SPDX-License-Identifier: Apache-2.0 */
/* The play-cell law in double precision. */
#include "formats/f64.h"

#include "generic/block_real.h"
#include "generic/cells_real.h"
#include "generic/cells_path.h"
#include "generic/cells_block.h"
#include "generic/cells.h"

#if ANHYST_MEMORIES > 1
#include "generic/solid.h"

static const anhyst_kernel_f64 kernel_solid;

static const anhyst_kernel_f64 *kernel_for_block(const entry *words)
{
  return layer_count(words) > 0 ? &kernel_solid : &anhyst_kernel_cells_f64;
}

static const anhyst_kernel_f64 kernel_solid = {
    ANHYST_KIND_CELLS,    solid_field_for_flux, solid_flux_for_current, is_cells_block_valid,
    solid_transfer_state, solid_store_state,    solid_init_state,       kernel_for_block};
#else
#define kernel_for_block 0
#endif

const anhyst_kernel_f64 anhyst_kernel_cells_f64 = {
    ANHYST_KIND_CELLS,    cells_field_for_flux, cells_flux_for_current, is_cells_block_valid,
    cells_transfer_state, cells_store_plays,    cells_init_state,       kernel_for_block};
