/* SPDX-License-Identifier: Apache-2.0 */
/* A wrench shared out in fixed point. RATIO and REST: the two functions of one number that a held
   drive takes. HOLD: a unit that is held, in any valid layout, from any forces and any numbers
   within -1..1 of what is free; ELIMINATE: what is taken off these. */
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

static void eliminate(const anhyst_wrench_q31 *w, sharing *s, const int32_t *share, int held,
                      uint16_t n)
{
  (void)w;
  (void)share;
  SHOW(held >= 0 && held < DRIVES && n <= 30U && !bit_of(s->free, held));
}

static void copy_apart(const anhyst_wrench_q31 *w, sharing *s)
{
  (void)w;
  s->changed = 1; /* s has any numbers already */
}
#endif

#ifdef ELIMINATE
static int32_t rest(int32_t number, int32_t share, int32_t other, uint16_t n)
{
  (void)share;
  SHOW(number >= -ANHYST_Q30_ONE && number <= ANHYST_Q30_ONE && n <= 30U);
  SHOW(other >= -ANHYST_Q30_ONE && other <= ANHYST_Q30_ONE);
  return any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}
#endif

#if defined(HOLD) || defined(ELIMINATE)
static void prove_held(void)
{
  int32_t apart[DRIVES * DRIVES];
  const anhyst_wrench_layout_q31 layout = {
      .axes = 6, .drives = nondet_u16(), .whole = {{0, 0}, apart}};
  const anhyst_wrench_q31 w = {&layout, nondet_u32()};
  sharing s = {.way = &layout.whole, .free = nondet_u16(), .changed = nondet_u16() & 1};
  const uint16_t j = nondet_u16();
  int32_t share[DRIVES];
  ASSUME(layout.drives <= DRIVES && j < layout.drives);
  for (int i = 0; i < DRIVES; i++) {
    s.force[i] = nondet_i32();
    share[i] = nondet_i32();
    for (int k = 0; k < DRIVES; k++) {
      apart[i * DRIVES + k] = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
      s.apart[i][k] = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE);
    }
  }
#ifdef HOLD
  (void)share;
  (void)hold(&w, &s, (int)j, nondet_i32());
#else
  const uint16_t n = nondet_u16();
  ASSUME(n <= 30U);
  eliminate(&w, &s, share, (int)j, n);
#endif
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
  prove_held();
#endif
  return 0;
}
