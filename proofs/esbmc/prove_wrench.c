/* SPDX-License-Identifier: Apache-2.0 */
/* A wrench shared out in fixed point. RATIO and REST: the two functions of one number that a held
   drive takes. HOLD: a unit that is held, in any valid layout, from any forces and any numbers
   within -1..1 of what is free. SHARE: all around it, with any drives lost. */
#include "any.h"

uint32_t nondet_u32(void);

#include "control/wrench_fixed.c"

#if defined(REST) || defined(HOLD)
#include "wide.h"
#endif

#ifdef HOLD
static int32_t ratio(int32_t number, int32_t pivot, uint16_t n)
{
  SHOW(number >= -ANHYST_Q30_ONE && number <= ANHYST_Q30_ONE && pivot > 0 && n <= 30U);
  return nondet_i32();
}

static int32_t rest(int32_t number, int32_t share, int32_t other, uint16_t n)
{
  (void)share;
  SHOW(number >= -ANHYST_Q30_ONE && number <= ANHYST_Q30_ONE && n <= 30U);
  SHOW(other >= -ANHYST_Q30_ONE && other <= ANHYST_Q30_ONE);
  return any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static void prove_hold(void)
{
  int32_t apart[DRIVES * DRIVES];
  uint16_t against[DRIVES];
  const anhyst_wrench_layout_q31 layout = {
      .axes = 6, .drives = nondet_u16(), .against = against, .whole = {{0, 0}, apart}};
  const anhyst_wrench_q31 w = {&layout, nondet_u32()};
  search s = {.way = &layout.whole, .free = nondet_u16(), .changed = nondet_u16() & 1};
  const uint16_t j = nondet_u16();
  ASSUME(layout.drives <= DRIVES && j < layout.drives);
  for (int i = 0; i < DRIVES * DRIVES; i++) {
    apart[i] = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
    s.apart[i / DRIVES][i % DRIVES] = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
  }
  for (int i = 0; i < DRIVES; i++) {
    s.force[i] = nondet_i32();
  }
  (void)hold(&w, &s, (int)j, nondet_i32());
}
#endif

int main(void)
{
#if defined(RATIO)
  const int32_t pivot = any_within(1, ANHYST_Q31_MAX);
  SHOW(digits(pivot) >= 15U && digits(pivot) <= 30U);
  (void)ratio(any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), pivot, digits(pivot));
#elif defined(REST)
  const uint16_t n = nondet_u16();
  ASSUME(n <= 30U);
  const int32_t found = rest(any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), nondet_i32(),
                             any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE), n);
  SHOW(found >= -ANHYST_Q30_ONE && found <= ANHYST_Q30_ONE);
#else
  prove_hold();
#endif
  return 0;
}
