/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the fixed-point compensator, and of nested calls. */
static int nested; /* calls that found another call in progress */
#define ANHYST_ASSERT(is_true) (nested += (is_true) ? 0 : 1)
#include "compensator/compensator.c" /* NOLINT(bugprone-suspicious-include) */

#define FORMAT(name) name
#define signal int32_t
#define FULL_DEMAND ((int32_t)2000000000)
#define FULL_CURRENT ((int32_t)2147483647)
#define CURRENT_LIMIT ((int32_t)268435456)
#define GAP ((int32_t)1000000000)
#define GAP_LOW 0
#define GAP_HIGH ((int32_t)2147483647)
#define GAP_BELOW (-1)
#define SOLVE anhyst_compensator_solve_q31
#define COMMIT anhyst_compensator_commit_q31
#define SIGNALS(name) name##_q31
#define OUTPUT anhyst_compensator_output_q31
#define CONDITIONING(c, tick) anhyst_conditioning_q31(c, tick)

static entry integer_word(uint32_t value) { return (entry)(uint16_t)value; }

static entry word_of(double value, double one) { return (entry)(value * one); }

static void make_scales(entry *words) { (void)words; }

static void format_claims(anhyst_compensator *c);

#define main claims
#include "compensator_claims.h"
#undef main

static int32_t nesting_field(anhyst_compensator *c)
{
  static int deep = 0;
  if (deep++ == 0) { /* a nested call, as from an interrupt */
    (void)anhyst_compensator_solve_q31(c, FULL_DEMAND / 9, GAP);
  }
  return linear_field(c);
}

static void format_claims(anhyst_compensator *c)
{
  static const anhyst_kernel nesting = {.kind = ANHYST_KIND_FULL, .field = nesting_field};
  CHECK(anhyst_compensator_solve_q15(c, 30000, 0) >= 0);
  COMMIT(c, INT32_MIN, GAP);
  CHECK((c->flags & ANHYST_CURRENT_LIMITED) != 0U);
  CHECK(nested == 0);
  c->kernel = &nesting;
  (void)anhyst_compensator_solve_q31(c, FULL_DEMAND / 8, GAP);
  CHECK(nested == 1);
}

int main(void) { return claims(); }
