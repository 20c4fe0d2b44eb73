/* SPDX-License-Identifier: Apache-2.0 */

#define ANHYST_FULL_SCALE_CODES R(2147483648.0)

static int is_scale_valid(ANHYST_REAL a) { return a >= R(1e-12) && a <= R(1e12); }

/* Converts a number to an integer code, truncated towards zero. Returns the lowest code for NaN. As
   a flux density, the lowest code means that no probe is present. */
static int32_t number_to_code(ANHYST_REAL codes)
{
  if (codes >= ANHYST_FULL_SCALE_CODES) {
    return ANHYST_Q31_MAX;
  }
  return codes > -ANHYST_FULL_SCALE_CODES ? (int32_t)codes : ANHYST_Q31_MIN;
}

static int32_t gap_code(const anhyst_coded_x *data, ANHYST_REAL gap)
{
  const int32_t initial = number_to_code((gap - data->gap_low) * data->gap);
  return initial > 0 ? initial : 0;
}

/* Returns whether a gap is in its range, extended by 2^-15 of the range at both ends. */
static int is_gap_in_range(const anhyst_coded_x *data, ANHYST_REAL gap)
{
  const ANHYST_REAL codes = (gap - data->gap_low) * data->gap;
  return codes >= R(-65536.0) && codes <= ANHYST_FULL_SCALE_CODES + R(65536.0);
}

static ANHYST_REAL solve_current(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  const anhyst_coded_x *data = c->own;
  const int is_gap_number = gap >= R(-1e30);
  const int32_t current = anhyst_force_controller_solve_q31(
      data->inner, is_gap_number ? number_to_code(demand * data->force) : ANHYST_Q31_MIN,
      gap_code(data, gap), number_to_code(flux * data->flux));
  c->flags = data->inner->flags;
  if (!is_gap_in_range(data, gap)) {
    c->flags |= ANHYST_GAP_LIMITED;
  }
  c->current = (ANHYST_REAL)current * data->ampere;
  return c->current;
}

static ANHYST_REAL commit_step(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  const anhyst_coded_x *data = c->own;
  const int32_t force = anhyst_force_controller_commit_q31(
      data->inner, number_to_code(applied * data->current), gap_code(data, gap));
  return (ANHYST_REAL)force * data->newton;
}

static ANHYST_REAL expected_force(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                                  ANHYST_REAL gap)
{
  const anhyst_coded_x *data = c->own;
  const int32_t force = anhyst_force_controller_expected_q31(
      data->inner, number_to_code(applied * data->current), gap_code(data, gap));
  return (ANHYST_REAL)force * data->newton;
}

static int32_t conditioning_ticks(const anhyst_force_controller_x *c)
{
  const anhyst_coded_x *data = c->own;
  return anhyst_force_controller_conditioning_length_q31(data->inner);
}

static ANHYST_REAL conditioning_current(const anhyst_force_controller_x *c, int32_t tick)
{
  const anhyst_coded_x *data = c->own;
  return (ANHYST_REAL)anhyst_force_controller_conditioning_q31(data->inner, tick) * data->ampere;
}

static void demagnetise(anhyst_force_controller_x *c)
{
  const anhyst_coded_x *data = c->own;
  anhyst_force_controller_demagnetise_q31(data->inner);
}

/* Does nothing, because the inner controller directly accepts another block of q31 words. */
static void transfer_state(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  (void)c;
  (void)block;
}

anhyst_status anhyst_force_controller_init_coded_x(anhyst_force_controller_x *c,
                                                   anhyst_coded_x *coded,
                                                   const anhyst_code_scales_x *scales,
                                                   anhyst_force_controller_q31 *inner)
{
  static const anhyst_force_method_x by_codes = {
      solve_current,        commit_step, expected_force, conditioning_ticks,
      conditioning_current, demagnetise, transfer_state};
  const anhyst_force_controller_x initial = {.method = &by_codes, .own = coded};
  const ANHYST_REAL range = scales->gap_high - scales->gap_low;
  if (!is_scale_valid(scales->demand) || !is_scale_valid(scales->current) ||
      !is_scale_valid(scales->flux) || !is_scale_valid(range)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = initial;
  coded->inner = inner;
  coded->force = ANHYST_FULL_SCALE_CODES / scales->demand;
  coded->current = ANHYST_FULL_SCALE_CODES / scales->current;
  coded->flux = ANHYST_FULL_SCALE_CODES / scales->flux;
  coded->gap = ANHYST_FULL_SCALE_CODES / range;
  coded->gap_low = scales->gap_low;
  coded->newton = scales->demand / ANHYST_FULL_SCALE_CODES;
  coded->ampere = scales->current / ANHYST_FULL_SCALE_CODES;
  return ANHYST_OK;
}

#undef ANHYST_FULL_SCALE_CODES
