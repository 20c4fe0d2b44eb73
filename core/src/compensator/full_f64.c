/* SPDX-License-Identifier: Apache-2.0 */
/* The Jiles-Atherton law in double precision, made from generic/full.h. */
#include "formats/f64.h"

/* Longest Newton step without an evaluation after it; its error is below a double's rounding. */
#define MAX_TANGENT_STEP (ONE / 1073741824)
#include "generic/full_real.h"

#include "generic/full.h"

const anhyst_kernel_f64 anhyst_kernel_full_f64 = {
    ANHYST_KIND_FULL, field_for_flux, flux_for_current, is_block_valid, transfer_state, 0, 0, 0};
