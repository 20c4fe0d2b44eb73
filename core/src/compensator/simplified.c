/* SPDX-License-Identifier: Apache-2.0 */
/* The simplified law in fixed point. */
#include "closed_form_fixed.h"
#include "generic/closed_form.h"
#include "generic/simplified.h"

static int is_valid(const int16_t *words)
{
  return path_is_valid(words) && closed_form_is_valid(words);
}

const anhyst_kernel anhyst_kernel_simplified = {
    ANHYST_KIND_SIMPLIFIED, simplified_field, simplified_flux, is_valid, simplified_carry, 0, 0, 0};
