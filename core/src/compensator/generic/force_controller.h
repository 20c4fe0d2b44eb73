/* SPDX-License-Identifier: Apache-2.0 */

/* Template: methods of the force controller, for every number format. The operations of a format
   are included before: ../force_controller.c for q31, force_controller_real.h for real numbers. */

static int are_current_limits_valid(ANHYST_REAL low, ANHYST_REAL high)
{
  return is_finite(low) && is_finite(high) && low <= high;
}

/* Adds the correction from the measured flux to a current, and limits the sum. */
static ANHYST_REAL apply_correction(anhyst_force_controller_x *c, ANHYST_REAL current)
{
  c->unlimited_current = anhyst_add_x(current, c->correction);
  c->current = limit_current(c, c->unlimited_current);
  if (c->current != c->unlimited_current) {
    c->flags |= ANHYST_CURRENT_LIMITED;
  }
  return c->current;
}

/* ---- method map ---- */

static void accept_demand(anhyst_force_controller_x *c, ANHYST_REAL demand)
{
  c->solved = 1;
  c->demand = limit_demand(c->map, demand);
  c->flags = c->demand != demand ? ANHYST_DEMAND_LIMITED : 0U;
}

static ANHYST_REAL solve_by_map(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                                ANHYST_REAL flux)
{
  (void)flux;
  accept_demand(c, demand);
  return apply_correction(c, anhyst_map_value_x(c->map, c->demand, gap));
}

/* Returns the force of an applied current. The argument `added` is a flux correction in it. */
static ANHYST_REAL force_by_map(anhyst_force_controller_x *c, ANHYST_REAL applied,
                                ANHYST_REAL added, ANHYST_REAL gap)
{
  if (c->solved != 0U && applied == c->unlimited_current) {
    return c->demand;
  }
  return anhyst_map_force_x(c->map, anhyst_sub_x(applied, added), gap);
}

static ANHYST_REAL commit_by_map(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL output = force_by_map(c, applied, 0, gap);
  c->solved = 0;
  return output;
}

static ANHYST_REAL expected_by_map(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                   ANHYST_REAL gap)
{
  return anhyst_map_force_x(c->map, applied, gap);
}

/* A map has no hysteresis state. */
static int32_t no_conditioning_ticks(const anhyst_force_controller_x *c)
{
  (void)c;
  return 0;
}

static ANHYST_REAL no_conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  (void)c;
  (void)tick;
  return 0;
}

static void no_demagnetise(anhyst_force_controller_x *c) { (void)c; }

static void no_state_transfer(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  (void)c;
  (void)block;
}

anhyst_status anhyst_force_controller_init_map_x(anhyst_force_controller_x *c,
                                                 const anhyst_map_x *map, ANHYST_REAL low,
                                                 ANHYST_REAL high)
{
  static const anhyst_force_method_x by_map = {
      solve_by_map,          commit_by_map,           expected_by_map,
      no_conditioning_ticks, no_conditioning_current, no_demagnetise,
      no_state_transfer};
  const anhyst_force_controller_x initial = {0};
  if (anhyst_map_check_x(map) != ANHYST_OK || !are_current_limits_valid(low, high)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  c->method = &by_map;
  c->map = map;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}

/* ---- method flux ---- */

static ANHYST_REAL solve_by_flux(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  accept_demand(c, demand);
  update_correction(c, gap, flux);
  return apply_correction(c, anhyst_map_value_x(c->map, c->demand, gap));
}

static ANHYST_REAL commit_by_flux(anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  const ANHYST_REAL added = c->solved == 0U ? integral_current(c) : c->correction;
  const ANHYST_REAL output = force_by_map(c, applied, added, gap);
  if (c->solved != 0U) {
    advance_flux_loop(c, applied);
  }
  c->solved = 0;
  return output;
}

anhyst_status anhyst_force_controller_init_flux_x(anhyst_force_controller_x *c,
                                                  const anhyst_map_x *map,
                                                  const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                                  ANHYST_REAL high)
{
  static const anhyst_force_method_x by_flux = {
      solve_by_flux,           commit_by_flux, expected_by_map,  no_conditioning_ticks,
      no_conditioning_current, no_demagnetise, no_state_transfer};
  if (anhyst_map_check_x(&loop->flux_table) != ANHYST_OK || !is_flux_loop_valid(loop) ||
      anhyst_force_controller_init_map_x(c, map, low, high) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  c->method = &by_flux;
  c->loop = loop;
  return ANHYST_OK;
}

/* ---- method compensator and its bypass ---- */

static ANHYST_REAL solve_by_compensator(anhyst_force_controller_x *c, ANHYST_REAL demand,
                                        ANHYST_REAL gap, ANHYST_REAL flux)
{
  (void)flux;
  c->solved = 1;
  c->demand = demand;
  c->current = anhyst_compensator_solve_x(&c->compensator, demand, gap);
  c->flags = c->compensator.flags;
  return c->current;
}

/* Returns the demand plus the output of the applied current minus the output of the solved current.
   Both outputs contain the error of the conversion from flux to force. Only their difference is
   used, so that the error does not reach the integral of the outer controller. */
static ANHYST_REAL commit_by_compensator(anhyst_force_controller_x *c, ANHYST_REAL applied,
                                         ANHYST_REAL gap)
{
  const uint16_t limits = ANHYST_DEMAND_LIMITED | ANHYST_FLUX_LIMITED | ANHYST_CURRENT_LIMITED;
  anhyst_compensator_x *compensator = &c->compensator;
  const int is_as_demanded = c->solved != 0U && (compensator->flags & limits) == 0U;
  compensator->flux_applied = compensator->flux;
  const ANHYST_REAL solved = anhyst_compensator_output_x(compensator);
  anhyst_compensator_commit_x(compensator, applied, gap);
  const ANHYST_REAL output = anhyst_compensator_output_x(compensator);
  c->solved = 0;
  return is_as_demanded ? anhyst_add_x(c->demand, anhyst_sub_x(output, solved)) : output;
}

static ANHYST_REAL expected_by_compensator(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                           ANHYST_REAL gap)
{
  (void)applied;
  (void)gap;
  return anhyst_compensator_output_x(&c->compensator);
}

static int32_t conditioning_ticks(const anhyst_force_controller_x *c)
{
  return compensator_conditioning_ticks(&c->compensator);
}

static ANHYST_REAL conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  return anhyst_conditioning_x(&c->compensator, tick);
}

static void transfer_state(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  swap_compensator_block(&c->compensator, block);
}

const anhyst_force_method_x anhyst_force_by_compensator_x = {
    solve_by_compensator, commit_by_compensator, expected_by_compensator, conditioning_ticks,
    conditioning_current, demagnetise,           transfer_state};

static ANHYST_REAL commit_bypassed(anhyst_force_controller_x *c, ANHYST_REAL applied,
                                   ANHYST_REAL gap)
{
  const ANHYST_REAL output = commit_by_map(c, applied, gap);
  anhyst_compensator_commit_x(&c->compensator, applied, gap);
  return output;
}

void anhyst_force_controller_bypass_x(anhyst_force_controller_x *c, const anhyst_map_x *map,
                                      ANHYST_REAL low, ANHYST_REAL high)
{
  static const anhyst_force_method_x bypassed = {
      solve_by_map,         commit_bypassed, expected_by_map, conditioning_ticks,
      conditioning_current, demagnetise,     transfer_state};
  c->method = map != NULL ? &bypassed : &anhyst_force_by_compensator_x;
  c->map = map;
  c->low = low;
  c->high = high;
}

/* ---- fused compensator ---- */

static ANHYST_REAL solve_fused(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                               ANHYST_REAL flux)
{
  const ANHYST_REAL by_law = solve_by_compensator(c, demand, gap, flux);
  update_correction(c, gap, flux);
  limit_correction(c);
  return apply_correction(c, by_law);
}

/* Commits the current without the correction from the measured flux, because the correction
   compensates errors of the iron model. */
static ANHYST_REAL commit_fused(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  const uint16_t solved = c->solved;
  const ANHYST_REAL added = solved == 0U ? integral_current(c) : c->correction;
  const ANHYST_REAL output = commit_by_compensator(c, anhyst_sub_x(applied, added), gap);
  if (solved != 0U) {
    advance_flux_loop(c, applied);
    limit_integral(c);
  }
  return output;
}

anhyst_status anhyst_force_controller_fuse_x(anhyst_force_controller_x *c,
                                             const anhyst_flux_loop_x *loop, ANHYST_REAL low,
                                             ANHYST_REAL high)
{
  static const anhyst_force_method_x fused = {
      solve_fused,          commit_fused, expected_by_compensator, conditioning_ticks,
      conditioning_current, demagnetise,  transfer_state};
  if (anhyst_map_check_x(&loop->flux_table) != ANHYST_OK || !is_flux_loop_valid(loop) ||
      !are_current_limits_valid(low, high)) {
    return ANHYST_BAD_PARAMETER;
  }
  c->method = &fused;
  c->loop = loop;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}
