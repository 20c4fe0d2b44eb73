/* SPDX-License-Identifier: Apache-2.0 */

/* Returns the current that compensates eddy currents, in the unit of the inner controller. */
static ANHYST_REAL eddy_lead_current(const anhyst_corrected_x *data)
{
  return data->correction.lead * (data->root - data->previous_root);
}

static ANHYST_REAL solve_current(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  anhyst_corrected_x *data = c->own;
  const anhyst_correction_x *k = &data->correction;
  const ANHYST_REAL current =
      anhyst_force_controller_solve_x(data->inner, demand, gap - k->zero, flux * k->density);
  data->root = demand > R(0.0) ? ANHYST_SQRT(demand) : R(0.0);
  c->flags = data->inner->flags;
  c->current = (current + eddy_lead_current(data)) / k->scale;
  return c->current;
}

static ANHYST_REAL commit_step(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  anhyst_corrected_x *data = c->own;
  const ANHYST_REAL iron_current = applied * data->correction.scale - eddy_lead_current(data);
  data->previous_root = data->root;
  return anhyst_force_controller_commit_x(data->inner, iron_current, gap - data->correction.zero);
}

static ANHYST_REAL expected_force(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  const anhyst_corrected_x *data = c->own;
  return anhyst_force_controller_expected_x(
      data->inner, applied * data->correction.scale - eddy_lead_current(data),
      gap - data->correction.zero);
}

static int32_t conditioning_ticks(const anhyst_force_controller_x *c)
{
  const anhyst_corrected_x *data = c->own;
  return anhyst_force_controller_conditioning_length_x(data->inner);
}

static ANHYST_REAL conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  const anhyst_corrected_x *data = c->own;
  return anhyst_force_controller_conditioning_x(data->inner, tick) / data->correction.scale;
}

static void demagnetise(anhyst_force_controller_x *c)
{
  anhyst_corrected_x *data = c->own;
  data->root = R(0.0);
  data->previous_root = R(0.0);
  anhyst_force_controller_demagnetise_x(data->inner);
}

static void transfer_state(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  anhyst_corrected_x *data = c->own;
  anhyst_force_controller_carry_x(data->inner, block);
}

static int is_finite(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

anhyst_status anhyst_force_controller_init_corrected_x(anhyst_force_controller_x *c,
                                                       anhyst_corrected_x *corrected,
                                                       const anhyst_correction_x *correction,
                                                       anhyst_force_controller_x *inner)
{
  static const anhyst_force_method_x by_correction = {
      solve_current,        commit_step, expected_force, conditioning_ticks,
      conditioning_current, demagnetise, transfer_state};
  const anhyst_force_controller_x initial = {.method = &by_correction, .own = corrected};
  const anhyst_corrected_x start_data = {*correction, inner, R(0.0), R(0.0)};
  if (!is_finite(correction->zero) || !is_finite(correction->lead) ||
      !(correction->scale > R(0.0) && is_finite(correction->scale)) ||
      !(correction->density > R(0.0) && is_finite(correction->density))) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  *corrected = start_data;
  return ANHYST_OK;
}
