/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/numeric/factor.h"

int32_t anhyst_factor_product(int32_t x, anhyst_factor factor)
{
  if (factor.shift >= 0) {
    /* Shifted first, so that what the product's floor cuts off is not made larger. */
    return anhyst_scale(anhyst_shl_q31(x, (uint16_t)factor.shift), factor.mantissa);
  }
  return anhyst_scale(x, factor.mantissa) >> -factor.shift;
}
