/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: force_controller.c for q31, generic/force_controller_real.h for the others. */

anhyst_status ANHYST_NAME(anhyst_force_controller_init_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                                            const ANHYST_NAME(anhyst_map) *map,
                                                            ANHYST_REAL low, ANHYST_REAL high)
{
  const ANHYST_NAME(anhyst_force_controller) fresh = {0};
  if (ANHYST_NAME(anhyst_map_check)(map) != ANHYST_OK || !ANHYST_NAME(is_known)(low) ||
      !ANHYST_NAME(is_known)(high) || low > high) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->method = ANHYST_FORCE_BY_MAP;
  c->map = map;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}

void ANHYST_NAME(anhyst_force_controller_init_play)(ANHYST_NAME(anhyst_force_controller) *c,
                                                    ANHYST_NAME(anhyst_play_map) *play)
{
  const ANHYST_NAME(anhyst_force_controller) fresh = {0};
  *c = fresh;
  c->method = ANHYST_FORCE_BY_PLAY;
  c->play = play;
}

anhyst_status ANHYST_NAME(anhyst_force_controller_init_flux)(
    ANHYST_NAME(anhyst_force_controller) *c, const ANHYST_NAME(anhyst_map) *map,
    const ANHYST_NAME(anhyst_flux_loop) *loop, ANHYST_REAL low, ANHYST_REAL high)
{
  if (ANHYST_NAME(anhyst_map_check)(&loop->wanted) != ANHYST_OK || !ANHYST_NAME(is_valid)(loop) ||
      ANHYST_NAME(anhyst_force_controller_init_map)(c, map, low, high) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  c->method = ANHYST_FORCE_BY_FLUX;
  c->loop = loop;
  return ANHYST_OK;
}

void ANHYST_NAME(anhyst_force_controller_bypass)(ANHYST_NAME(anhyst_force_controller) *c,
                                                 const ANHYST_NAME(anhyst_map) *map,
                                                 ANHYST_REAL low, ANHYST_REAL high)
{
  c->method = map != NULL ? ANHYST_FORCE_PAST_COMPENSATOR : ANHYST_FORCE_BY_COMPENSATOR;
  c->map = map;
  c->low = low;
  c->high = high;
}

ANHYST_REAL ANHYST_NAME(anhyst_force_controller_solve)(ANHYST_NAME(anhyst_force_controller) *c,
                                                       ANHYST_REAL demand, ANHYST_REAL gap,
                                                       ANHYST_REAL flux)
{
  c->solved = 1;
  if (c->method == ANHYST_FORCE_BY_COMPENSATOR) {
    c->demand = demand;
    c->current = ANHYST_NAME(anhyst_compensator_solve)(&c->compensator, demand, gap);
    c->flags = c->compensator.flags;
    return c->current;
  }
  if (c->method == ANHYST_FORCE_BY_PLAY) {
    c->current = c->play->solve(c->play, demand, gap);
    c->flags = c->play->flags;
    return c->current;
  }
  c->demand = ANHYST_NAME(pulling)(c->map, demand);
  c->flags = 0;
  if (c->demand != demand) {
    c->flags |= ANHYST_DEMAND_LIMITED;
  }
  c->correction = 0;
  if (c->method == ANHYST_FORCE_BY_FLUX) {
    ANHYST_NAME(correct)(c, gap, flux);
  }
  c->wanted =
      ANHYST_NAME(anhyst_add)(ANHYST_NAME(anhyst_map_value)(c->map, c->demand, gap), c->correction);
  c->current = ANHYST_NAME(limited)(c, c->wanted);
  if (c->current != c->wanted) {
    c->flags |= ANHYST_CURRENT_LIMITED;
  }
  return c->current;
}

/* What the compensator expects, beside what it expected of the solved current: both have the error
   of the way back from flux to force, which must not reach the integral of whoever asked. */
static ANHYST_REAL ANHYST_NAME(commit_compensator)(ANHYST_NAME(anhyst_force_controller) *c,
                                                   ANHYST_REAL applied, ANHYST_REAL gap)
{
  ANHYST_NAME(anhyst_compensator) *compensator = &c->compensator;
  compensator->flux_applied = compensator->flux;
  const ANHYST_REAL solved = ANHYST_NAME(anhyst_compensator_output)(compensator);
  ANHYST_NAME(anhyst_compensator_commit)(compensator, applied, gap);
  const ANHYST_REAL output = ANHYST_NAME(anhyst_compensator_output)(compensator);
  const uint16_t other = ANHYST_DEMAND_LIMITED | ANHYST_FLUX_LIMITED;
  if (c->solved == 0U || (c->flags & other) != 0U) {
    return output;
  }
  return ANHYST_NAME(anhyst_add)(c->demand, ANHYST_NAME(anhyst_sub)(output, solved));
}

ANHYST_REAL ANHYST_NAME(anhyst_force_controller_commit)(ANHYST_NAME(anhyst_force_controller) *c,
                                                        ANHYST_REAL applied, ANHYST_REAL gap)
{
  ANHYST_REAL output = c->demand;
  if (c->method == ANHYST_FORCE_BY_COMPENSATOR) {
    output = ANHYST_NAME(commit_compensator)(c, applied, gap);
  } else if (c->method == ANHYST_FORCE_BY_PLAY) {
    output = c->play->commit(c->play, applied, gap);
  } else if (c->solved == 0U || applied != c->wanted) {
    const ANHYST_REAL added = c->solved == 0U ? ANHYST_NAME(held)(c) : c->correction;
    output = ANHYST_NAME(anhyst_map_force)(c->map, ANHYST_NAME(anhyst_sub)(applied, added), gap);
  }
  if (c->method == ANHYST_FORCE_PAST_COMPENSATOR) {
    ANHYST_NAME(anhyst_compensator_commit)(&c->compensator, applied, gap);
  }
  if (c->method == ANHYST_FORCE_BY_FLUX && c->solved != 0U) {
    ANHYST_NAME(advance_flux)(c, applied);
  }
  c->solved = 0;
  return output;
}

static int ANHYST_NAME(has_compensator)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  return c->method == ANHYST_FORCE_BY_COMPENSATOR || c->method == ANHYST_FORCE_PAST_COMPENSATOR;
}

int32_t ANHYST_NAME(anhyst_force_controller_conditioning_length)(
    const ANHYST_NAME(anhyst_force_controller) *c)
{
  return ANHYST_NAME(has_compensator)(c) ? ANHYST_NAME(conditioning_length)(&c->compensator) : 0;
}

ANHYST_REAL ANHYST_NAME(anhyst_force_controller_conditioning)(
    const ANHYST_NAME(anhyst_force_controller) *c, int32_t tick)
{
  return ANHYST_NAME(has_compensator)(c) ? ANHYST_NAME(anhyst_conditioning)(&c->compensator, tick)
                                         : 0;
}
