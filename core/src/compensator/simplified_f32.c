/* SPDX-License-Identifier: Apache-2.0 */
/* The simplified law in single precision. */
#include "formats/f32.h"

#include "generic/simplified_real.h"
#include "generic/simplified.h"
#include "generic/closed_form.h"

const anhyst_kernel_f32 anhyst_kernel_simplified_f32 = {ANHYST_KIND_SIMPLIFIED,
                                                        simplified_field_for_flux,
                                                        simplified_flux_for_current,
                                                        is_simplified_block_valid,
                                                        simplified_transfer_state,
                                                        0,
                                                        0,
                                                        0};
