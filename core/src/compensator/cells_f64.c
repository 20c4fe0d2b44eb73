/* SPDX-License-Identifier: Apache-2.0 */
/* The law of play cells in double precision. */
#include "formats/f64.h"

#include "formats/block_real.h"
#include "generic/cells_real.h"
#include "generic/cells_path.h"
#include "generic/cells_block.h"
#include "generic/cells.h"

#define FOR_BLOCK 0

const anhyst_kernel_f64 anhyst_kernel_cells_f64 = {ANHYST_KIND_CELLS, cells_field, cells_flux,
                                                   cells_is_valid,    cells_carry, cells_keep,
                                                   cells_start,       FOR_BLOCK};
