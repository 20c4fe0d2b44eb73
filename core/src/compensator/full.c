/* SPDX-License-Identifier: Apache-2.0 */
/* The law of Jiles and Atherton in fixed point; its text is generic/full.h. */
#include "full_fixed.h"

#include "generic/full.h"

const anhyst_kernel anhyst_kernel_full = {
    ANHYST_KIND_FULL, field_for_flux, flux_for_current, is_valid, carry, 0, 0, 0};
