/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law in single precision, made from generic/full.h. */
#include "formats/f32.h"

#define MAX_TANGENT_STEP (ONE / 256)
#include "generic/full_real.h"

#include "generic/full.h"

const anhyst_kernel_f32 anhyst_kernel_full_f32 = {
    ANHYST_KIND_FULL, field_for_flux, flux_for_current, is_block_valid, transfer_state, 0, 0, 0};
