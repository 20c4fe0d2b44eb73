/* SPDX-License-Identifier: Apache-2.0 */
/* Proves every operator of fixed.h except anhyst_scale, for all arguments within its
   preconditions. */
#include "any.h"

#include "anhyst/numeric/fixed.h"

int main(void)
{
  const int16_t a = nondet_i16();
  const int16_t b = nondet_i16();
  const int32_t x = nondet_i32();
  const int32_t y = nondet_i32();
  (void)anhyst_sat_q15(x);
  SHOW(anhyst_sat_u15(x) == anhyst_clamp(x, 0, ANHYST_Q15_MAX));
  SHOW(anhyst_sat_q28(x) == anhyst_clamp(x, ANHYST_Q28_MIN, ANHYST_Q28_MAX));
  SHOW(anhyst_sat_q30(x) == anhyst_clamp(x, -ANHYST_Q30_ONE, ANHYST_Q30_ONE - 1));
  (void)anhyst_add_q15(a, b);
  (void)anhyst_sub_q15(a, b);
  (void)anhyst_mul_q15(a, b);
  (void)anhyst_round_q31(x);
  SHOW(anhyst_abs_q31(x) >= 0);
  SHOW(anhyst_add_q31(x, y) == anhyst_add_q31(y, x));
  SHOW(x < y || anhyst_sub_q31(x, y) >= 0);
  const int32_t low = nondet_i32();
  const int32_t high = any_within(low, ANHYST_Q31_MAX);
  const int32_t kept = anhyst_clamp(x, low, high);
  SHOW(kept >= low && kept <= high);
  const uint16_t n = nondet_u16();
  ASSUME(n <= 31);
  const int32_t shifted = anhyst_shl_q31(x, n);
  SHOW(x >= 0 ? shifted >= x : shifted <= x);
  if (x > 0) {
    const uint16_t room = anhyst_headroom(x);
    SHOW(room <= 30 && (x << room) >= 0x40000000);
  }
  return 0;
}
