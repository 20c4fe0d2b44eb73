/* SPDX-License-Identifier: Apache-2.0 */
/* Additional claims of the floating-point formats: words and signals that are NaN. */
#include <stdint.h>

static entry integer_word(uint32_t value) { return (entry)value; }

static entry word_of(double value, double one)
{
  (void)one;
  return (entry)value;
}

static void make_scales(entry *words)
{
  words[ANHYST_WORD_SCALE_DEMAND] = FULL_DEMAND;
  words[ANHYST_WORD_SCALE_CURRENT] = FULL_CURRENT;
  words[ANHYST_WORD_SCALE_GAP_LOW] = GAP_LOW;
  words[ANHYST_WORD_SCALE_GAP_HIGH] = GAP_HIGH;
}

static uint16_t flags_of_solve(compensator *c, signal demand, signal gap);
static uint16_t flags_of_commit(compensator *c, signal applied, signal gap);

static void format_claims(compensator *c)
{
  const signal none = (signal)NAN;
  const signal endless = (signal)INFINITY;
  const signal millimetres = (signal)0.4;
  CHECK(flags_of_solve(c, FULL_DEMAND / 8, millimetres) == ANHYST_GAP_LIMITED);
  CHECK(flags_of_solve(c, FULL_DEMAND / 8, none) == ANHYST_GAP_LIMITED);
  CHECK(flags_of_solve(c, FULL_DEMAND / 8, endless) == ANHYST_GAP_LIMITED);
  CHECK(flags_of_solve(c, FULL_DEMAND / 8, -endless) == ANHYST_GAP_LIMITED);
  CHECK((flags_of_solve(c, none, GAP) & ANHYST_DEMAND_LIMITED) != 0U);
  CHECK(SOLVE(c, none, GAP) == SOLVE(c, -FULL_DEMAND, GAP));
  CHECK(flags_of_commit(c, FULL_CURRENT / 9, none) == ANHYST_GAP_LIMITED);
  CHECK(flags_of_commit(c, (signal)3000, GAP) == ANHYST_CURRENT_LIMITED);
  COMMIT(c, FULL_CURRENT / 9, GAP);
  const number before = c->memory.full.x;
  CHECK(flags_of_commit(c, none, GAP) == ANHYST_CURRENT_LIMITED);
  CHECK(flags_of_commit(c, endless, GAP) == ANHYST_CURRENT_LIMITED);
  CHECK(c->memory.full.x == before && c->stage == ANHYST_STAGE_UNKNOWN);
}
