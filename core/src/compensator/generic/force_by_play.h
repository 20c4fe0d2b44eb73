/* SPDX-License-Identifier: Apache-2.0 */

static ANHYST_REAL ANHYST_NAME(solve)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL demand,
                                      ANHYST_REAL gap, ANHYST_REAL flux)
{
  ANHYST_NAME(anhyst_play_map) *play = c->own;
  (void)flux;
  c->current = ANHYST_NAME(anhyst_play_map_solve)(play, demand, gap);
  c->flags = play->flags;
  return c->current;
}

static ANHYST_REAL ANHYST_NAME(commit)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL applied,
                                       ANHYST_REAL gap)
{
  return ANHYST_NAME(anhyst_play_map_commit)(c->own, applied, gap);
}

static ANHYST_REAL ANHYST_NAME(expected)(const ANHYST_NAME(anhyst_force_controller) *c,
                                         ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_play_map) *play = c->own;
  (void)applied;
  (void)gap;
  return play->demand;
}

/* Any play is one: nothing has to be made known. */
static int32_t ANHYST_NAME(length)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  (void)c;
  return 0;
}

static ANHYST_REAL ANHYST_NAME(conditioning)(const ANHYST_NAME(anhyst_force_controller) *c,
                                             int32_t tick)
{
  (void)c;
  (void)tick;
  return 0;
}

static void ANHYST_NAME(demagnetise)(ANHYST_NAME(anhyst_force_controller) *c) { (void)c; }

static void ANHYST_NAME(carry)(ANHYST_NAME(anhyst_force_controller) *c,
                               const ANHYST_NAME(anhyst_block) *block)
{
  (void)c;
  (void)block;
}

void ANHYST_NAME(anhyst_force_controller_init_play)(ANHYST_NAME(anhyst_force_controller) *c,
                                                    ANHYST_NAME(anhyst_play_map) *play)
{
  static const ANHYST_NAME(anhyst_force_method) by_play = {
      ANHYST_NAME(solve),  ANHYST_NAME(commit),       ANHYST_NAME(expected),
      ANHYST_NAME(length), ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  const ANHYST_NAME(anhyst_force_controller) fresh = {0};
  *c = fresh;
  c->method = &by_play;
  c->own = play;
}
