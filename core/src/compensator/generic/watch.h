/* SPDX-License-Identifier: Apache-2.0 */
/* What an interrupt needs beside solve and commit, the same in every format. */

/* The tick of the start-up sequence that is due, and whether there is one. */
static int32_t next_conditioning_tick(compensator *c, int32_t length)
{
  if (c->conditioned < length) {
    c->flags = (uint16_t)(c->flags | ANHYST_CONDITIONING);
    return c->conditioned++;
  }
  c->flags = (uint16_t)(c->flags & ~ANHYST_CONDITIONING);
  return length;
}

/* Whether the iron goes on while nothing is computed: layers or a lag. */
static int depends_on_time(const compensator *c)
{
  const entry *words = c->words;
  return words[ANHYST_WORD_GAP_LAG_ARM] > (entry)0 ||
         (c->kernel->kind == ANHYST_KIND_CELLS && words[ANHYST_WORD_SOLID_LAYERS] > (entry)0);
}

/* Commits that stand for so many ticks in which the current stayed. */
static uint16_t commits_for(const compensator *c, uint16_t ticks)
{
  if (!depends_on_time(c) || ticks == 0U) {
    return 1;
  }
  return ticks < ANHYST_CATCH_UP_TICKS_MAX ? ticks : (uint16_t)ANHYST_CATCH_UP_TICKS_MAX;
}
