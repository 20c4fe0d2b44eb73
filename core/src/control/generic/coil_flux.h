/* SPDX-License-Identifier: Apache-2.0 */

/* Template: the force controller with a coil, for every number format. The operations that depend
   on the format are included before: ../coil_flux.c for q31, coil_flux_real.h for real numbers. */

/* Updates the estimate with the voltage of the last tick. */
static void update_estimate(anhyst_coil_flux_x *coil, ANHYST_REAL voltage)
{
  const uint16_t limits = ANHYST_DEMAND_LIMITED | ANHYST_CURRENT_LIMITED | ANHYST_FLUX_LIMITED;
  const ANHYST_REAL law = law_flux(coil);
  if (coil->is_running == 0U || !is_in_range(voltage, coil->settings.range)) {
    coil->deviation = 0;
  } else {
    integrate_voltage(coil, voltage, law, (coil->inner->flags & limits) == 0U);
  }
  coil->law = law;
  coil->is_running = 1;
}

static ANHYST_REAL solve_with_voltage(anhyst_force_controller_x *c, ANHYST_REAL demand,
                                      ANHYST_REAL gap, ANHYST_REAL voltage)
{
  anhyst_coil_flux_x *coil = c->own;
  if (coil->is_solved == 0U) {
    update_estimate(coil, voltage);
  }
  coil->is_solved = 1;
  c->current = anhyst_force_controller_solve_x(coil->inner, demand, gap,
                                               anhyst_add_x(coil->law, to_flux(coil->deviation)));
  c->flags = coil->inner->flags;
  return c->current;
}

static ANHYST_REAL commit_current(anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  anhyst_coil_flux_x *coil = c->own;
  coil->current = anhyst_add_x(
      coil->current, times_share(anhyst_sub_x(applied, coil->current), coil->settings.lag));
  coil->is_running = coil->is_solved;
  coil->is_solved = 0;
  return anhyst_force_controller_commit_x(coil->inner, applied, gap);
}

static ANHYST_REAL expected_force(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  const anhyst_coil_flux_x *coil = c->own;
  return anhyst_force_controller_expected_x(coil->inner, applied, gap);
}

static int32_t conditioning_ticks(const anhyst_force_controller_x *c)
{
  const anhyst_coil_flux_x *coil = c->own;
  return anhyst_force_controller_conditioning_length_x(coil->inner);
}

static ANHYST_REAL conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  const anhyst_coil_flux_x *coil = c->own;
  return anhyst_force_controller_conditioning_x(coil->inner, tick);
}

static void demagnetise(anhyst_force_controller_x *c)
{
  anhyst_coil_flux_x *coil = c->own;
  coil->is_running = 0;
  anhyst_force_controller_demagnetise_x(coil->inner);
}

static void transfer_state(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  anhyst_coil_flux_x *coil = c->own;
  anhyst_force_controller_carry_x(coil->inner, block);
}

anhyst_status anhyst_force_controller_init_coil_x(anhyst_force_controller_x *c,
                                                  anhyst_coil_flux_x *coil,
                                                  const anhyst_coil_flux_settings_x *settings,
                                                  anhyst_force_controller_x *inner)
{
  static const anhyst_force_method_x by_coil = {
      solve_with_voltage,   commit_current, expected_force, conditioning_ticks,
      conditioning_current, demagnetise,    transfer_state};
  const anhyst_force_controller_x initial = {.method = &by_coil, .own = coil};
  const anhyst_coil_flux_x start = {.settings = *settings, .inner = inner};
  if (inner->loop == NULL || !are_settings_valid(settings)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  *coil = start;
  start_learning(coil);
  return ANHYST_OK;
}
