/* SPDX-License-Identifier: Apache-2.0 */
/* Functions for an ISR in addition to solve and commit; for every number format. */

/* Returns the next tick of the conditioning sequence, and its length after its end. Updates the
   flag that shows whether the sequence is running. */
static int32_t next_conditioning_tick(compensator *c, int32_t length)
{
  if (c->conditioned < length) {
    c->flags = (uint16_t)(c->flags | ANHYST_CONDITIONING);
    return c->conditioned++;
  }
  c->flags = (uint16_t)(c->flags & ~ANHYST_CONDITIONING);
  return length;
}

/* Returns whether the state changes over time at a constant current, because of layers or a lag. */
static int is_time_dependent(const compensator *c)
{
  const entry *words = c->words;
  return words[ANHYST_WORD_GAP_LAG_ARM] > (entry)0 ||
         (c->kernel->kind == ANHYST_KIND_CELLS && words[ANHYST_WORD_SOLID_LAYERS] > (entry)0);
}

/* Returns the number of commits that represent this number of ticks at a constant current. */
static uint16_t count_commits(const compensator *c, uint16_t ticks)
{
  if (!is_time_dependent(c) || ticks == 0U) {
    return 1;
  }
  return ticks < ANHYST_CATCH_UP_TICKS_MAX ? ticks : (uint16_t)ANHYST_CATCH_UP_TICKS_MAX;
}
