/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law in fixed point, made from generic/full.h. */
#include "full_fixed.h"

#include "generic/full.h"

const anhyst_kernel anhyst_kernel_full = {
    ANHYST_KIND_FULL, field_for_flux, flux_for_current, is_block_valid, transfer_state, 0, 0, 0};
