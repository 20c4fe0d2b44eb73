/* SPDX-License-Identifier: Apache-2.0 */
/* The simplified law in fixed point. */
#include "simplified_fixed.h"

#include "generic/simplified.h"
#include "generic/closed_form.h"

const anhyst_kernel anhyst_kernel_simplified = {ANHYST_KIND_SIMPLIFIED,
                                                simplified_field_for_flux,
                                                simplified_flux_for_current,
                                                is_simplified_block_valid,
                                                simplified_transfer_state,
                                                0,
                                                0,
                                                0};
