/* SPDX-License-Identifier: Apache-2.0 */

/* What eddy currents take of the current while the force changes as it is asked for. */
static ANHYST_REAL ANHYST_NAME(led)(const ANHYST_NAME(anhyst_corrected) *own)
{
  return own->correction.lead * (own->root - own->before);
}

static ANHYST_REAL ANHYST_NAME(solve)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL demand,
                                      ANHYST_REAL gap, ANHYST_REAL flux)
{
  ANHYST_NAME(anhyst_corrected) *own = c->own;
  const ANHYST_NAME(anhyst_correction) *k = &own->correction;
  const ANHYST_REAL current = ANHYST_NAME(anhyst_force_controller_solve)(
      own->inner, demand, gap - k->zero, flux * k->density);
  own->root = demand > R(0.0) ? ANHYST_SQRT(demand) : R(0.0);
  c->flags = own->inner->flags;
  c->current = (current + ANHYST_NAME(led)(own)) / k->scale;
  return c->current;
}

static ANHYST_REAL ANHYST_NAME(commit)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL applied,
                                       ANHYST_REAL gap)
{
  ANHYST_NAME(anhyst_corrected) *own = c->own;
  const ANHYST_REAL left = applied * own->correction.scale - ANHYST_NAME(led)(own);
  own->before = own->root;
  return ANHYST_NAME(anhyst_force_controller_commit)(own->inner, left, gap - own->correction.zero);
}

static ANHYST_REAL ANHYST_NAME(expected)(const ANHYST_NAME(anhyst_force_controller) *c,
                                         ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_corrected) *own = c->own;
  return ANHYST_NAME(anhyst_force_controller_expected)(
      own->inner, applied * own->correction.scale - ANHYST_NAME(led)(own),
      gap - own->correction.zero);
}

static int32_t ANHYST_NAME(length)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  const ANHYST_NAME(anhyst_corrected) *own = c->own;
  return ANHYST_NAME(anhyst_force_controller_conditioning_length)(own->inner);
}

static ANHYST_REAL ANHYST_NAME(conditioning)(const ANHYST_NAME(anhyst_force_controller) *c,
                                             int32_t tick)
{
  const ANHYST_NAME(anhyst_corrected) *own = c->own;
  return ANHYST_NAME(anhyst_force_controller_conditioning)(own->inner, tick) /
         own->correction.scale;
}

static void ANHYST_NAME(demagnetise)(ANHYST_NAME(anhyst_force_controller) *c)
{
  ANHYST_NAME(anhyst_corrected) *own = c->own;
  own->root = R(0.0);
  own->before = R(0.0);
  ANHYST_NAME(anhyst_force_controller_demagnetise)(own->inner);
}

static void ANHYST_NAME(carry)(ANHYST_NAME(anhyst_force_controller) *c,
                               const ANHYST_NAME(anhyst_block) *block)
{
  ANHYST_NAME(anhyst_corrected) *own = c->own;
  ANHYST_NAME(anhyst_force_controller_carry)(own->inner, block);
}

static int ANHYST_NAME(is_number)(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

anhyst_status ANHYST_NAME(anhyst_force_controller_init_corrected)(
    ANHYST_NAME(anhyst_force_controller) *c, ANHYST_NAME(anhyst_corrected) *corrected,
    const ANHYST_NAME(anhyst_correction) *correction, ANHYST_NAME(anhyst_force_controller) *inner)
{
  static const ANHYST_NAME(anhyst_force_method) by_correction = {
      ANHYST_NAME(solve),  ANHYST_NAME(commit),       ANHYST_NAME(expected),
      ANHYST_NAME(length), ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  const ANHYST_NAME(anhyst_force_controller) fresh = {.method = &by_correction, .own = corrected};
  const ANHYST_NAME(anhyst_corrected) rest = {*correction, inner, R(0.0), R(0.0)};
  if (!ANHYST_NAME(is_number)(correction->zero) || !ANHYST_NAME(is_number)(correction->lead) ||
      !(correction->scale > R(0.0) && ANHYST_NAME(is_number)(correction->scale)) ||
      !(correction->density > R(0.0) && ANHYST_NAME(is_number)(correction->density))) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  *corrected = rest;
  return ANHYST_OK;
}
