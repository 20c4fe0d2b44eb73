/* SPDX-License-Identifier: Apache-2.0 */

static ANHYST_REAL solve_current(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  anhyst_play_map_x *play = c->own;
  (void)flux;
  c->current = anhyst_play_map_solve_x(play, demand, gap);
  c->flags = play->flags;
  return c->current;
}

static ANHYST_REAL commit_step(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  return anhyst_play_map_commit_x(c->own, applied, gap);
}

static ANHYST_REAL expected_force(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  const anhyst_play_map_x *play = c->own;
  (void)applied;
  (void)gap;
  return play->demand;
}

/* Returns 0 ticks. Every play is a valid state, so that no conditioning is necessary. */
static int32_t conditioning_ticks(const anhyst_force_controller_x *c)
{
  (void)c;
  return 0;
}

static ANHYST_REAL conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  (void)c;
  (void)tick;
  return 0;
}

static void demagnetise(anhyst_force_controller_x *c) { (void)c; }

static void transfer_state(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  (void)c;
  (void)block;
}

void anhyst_force_controller_init_play_x(anhyst_force_controller_x *c, anhyst_play_map_x *play)
{
  static const anhyst_force_method_x by_play = {
      solve_current,        commit_step, expected_force, conditioning_ticks,
      conditioning_current, demagnetise, transfer_state};
  const anhyst_force_controller_x initial = {0};
  *c = initial;
  c->method = &by_play;
  c->own = play;
}
