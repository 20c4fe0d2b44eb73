/* SPDX-License-Identifier: Apache-2.0 */
/* The simplified law in fixed point. */
#include "simplified_fixed.h"

#include "generic/simplified.h"
#include "generic/closed_form.h"

const anhyst_kernel anhyst_kernel_simplified = {ANHYST_KIND_SIMPLIFIED,
                                                simplified_field,
                                                simplified_flux,
                                                is_simplified_valid,
                                                simplified_carry,
                                                0,
                                                0,
                                                0};
