/* SPDX-License-Identifier: Apache-2.0 */

/* What eddy currents take of the current while the force changes as it is asked for. */
static ANHYST_REAL led(const anhyst_corrected_x *own)
{
  return own->correction.lead * (own->root - own->before);
}

static ANHYST_REAL solve(anhyst_force_controller_x *c, ANHYST_REAL demand, ANHYST_REAL gap,
                         ANHYST_REAL flux)
{
  anhyst_corrected_x *own = c->own;
  const anhyst_correction_x *k = &own->correction;
  const ANHYST_REAL current =
      anhyst_force_controller_solve_x(own->inner, demand, gap - k->zero, flux * k->density);
  own->root = demand > R(0.0) ? ANHYST_SQRT(demand) : R(0.0);
  c->flags = own->inner->flags;
  c->current = (current + led(own)) / k->scale;
  return c->current;
}

static ANHYST_REAL commit(anhyst_force_controller_x *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  anhyst_corrected_x *own = c->own;
  const ANHYST_REAL left = applied * own->correction.scale - led(own);
  own->before = own->root;
  return anhyst_force_controller_commit_x(own->inner, left, gap - own->correction.zero);
}

static ANHYST_REAL expected(const anhyst_force_controller_x *c, ANHYST_REAL applied,
                            ANHYST_REAL gap)
{
  const anhyst_corrected_x *own = c->own;
  return anhyst_force_controller_expected_x(own->inner, applied * own->correction.scale - led(own),
                                            gap - own->correction.zero);
}

static int32_t length(const anhyst_force_controller_x *c)
{
  const anhyst_corrected_x *own = c->own;
  return anhyst_force_controller_conditioning_length_x(own->inner);
}

static ANHYST_REAL conditioning(const anhyst_force_controller_x *c, int32_t tick)
{
  const anhyst_corrected_x *own = c->own;
  return anhyst_force_controller_conditioning_x(own->inner, tick) / own->correction.scale;
}

static void demagnetise(anhyst_force_controller_x *c)
{
  anhyst_corrected_x *own = c->own;
  own->root = R(0.0);
  own->before = R(0.0);
  anhyst_force_controller_demagnetise_x(own->inner);
}

static void carry(anhyst_force_controller_x *c, const anhyst_block_x *block)
{
  anhyst_corrected_x *own = c->own;
  anhyst_force_controller_carry_x(own->inner, block);
}

static int is_number(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

anhyst_status anhyst_force_controller_init_corrected_x(anhyst_force_controller_x *c,
                                                       anhyst_corrected_x *corrected,
                                                       const anhyst_correction_x *correction,
                                                       anhyst_force_controller_x *inner)
{
  static const anhyst_force_method_x by_correction = {solve,        commit,      expected, length,
                                                      conditioning, demagnetise, carry};
  const anhyst_force_controller_x fresh = {.method = &by_correction, .own = corrected};
  const anhyst_corrected_x rest = {*correction, inner, R(0.0), R(0.0)};
  if (!is_number(correction->zero) || !is_number(correction->lead) ||
      !(correction->scale > R(0.0) && is_number(correction->scale)) ||
      !(correction->density > R(0.0) && is_number(correction->density))) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  *corrected = rest;
  return ANHYST_OK;
}
