/* SPDX-License-Identifier: Apache-2.0 */
/* Proves anhyst_scale for any two numbers. */
#include "any.h"

#include "anhyst/numeric/fixed.h"

int main(void)
{
  const int32_t r = anhyst_scale(nondet_i32(), nondet_i16());
  SHOW(r >= -ANHYST_Q30_ONE && r <= ANHYST_Q30_ONE);
  return 0;
}
