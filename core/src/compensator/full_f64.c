/* SPDX-License-Identifier: Apache-2.0 */
/* The law of Jiles and Atherton in double precision; its text is generic/full.h. */
#include "formats/f64.h"

/* So short that a solution is as exact as the format. */
#define MAX_TANGENT_STEP (UNIT / 1073741824)
#include "generic/full_real.h"

#include "generic/full.h"

const anhyst_kernel_f64 anhyst_kernel_full_f64 = {
    ANHYST_KIND_FULL, field_for_flux, flux_for_current, is_valid, carry, 0, 0, 0};
