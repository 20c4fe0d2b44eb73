/* SPDX-License-Identifier: Apache-2.0 */

#define ANHYST_CODES R(2147483648.0)

static int ANHYST_NAME(is_scale)(ANHYST_REAL a) { return a >= R(1e-12) && a <= R(1e12); }

/* The next code towards zero; the lowest for what is no number, which of a flux density means no
   probe. */
static int32_t ANHYST_NAME(code)(ANHYST_REAL codes)
{
  if (codes >= ANHYST_CODES) {
    return ANHYST_Q31_MAX;
  }
  return codes > -ANHYST_CODES ? (int32_t)codes : ANHYST_Q31_MIN;
}

static int32_t ANHYST_NAME(gap_code)(const ANHYST_NAME(anhyst_coded) *own, ANHYST_REAL gap)
{
  const int32_t found = ANHYST_NAME(code)((gap - own->gap_low) * own->gap);
  return found > 0 ? found : 0;
}

static ANHYST_REAL ANHYST_NAME(solve)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL demand,
                                      ANHYST_REAL gap, ANHYST_REAL flux)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  const int known = gap >= R(-1e30);
  const int32_t current = anhyst_force_controller_solve_q31(
      own->inner, known ? ANHYST_NAME(code)(demand * own->force) : ANHYST_Q31_MIN,
      ANHYST_NAME(gap_code)(own, gap), ANHYST_NAME(code)(flux * own->flux));
  c->flags = own->inner->flags;
  c->current = (ANHYST_REAL)current * own->ampere;
  return c->current;
}

static ANHYST_REAL ANHYST_NAME(commit)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL applied,
                                       ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  const int32_t force = anhyst_force_controller_commit_q31(
      own->inner, ANHYST_NAME(code)(applied * own->current), ANHYST_NAME(gap_code)(own, gap));
  return (ANHYST_REAL)force * own->newton;
}

static ANHYST_REAL ANHYST_NAME(expected)(const ANHYST_NAME(anhyst_force_controller) *c,
                                         ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  const int32_t force = anhyst_force_controller_expected_q31(
      own->inner, ANHYST_NAME(code)(applied * own->current), ANHYST_NAME(gap_code)(own, gap));
  return (ANHYST_REAL)force * own->newton;
}

static int32_t ANHYST_NAME(length)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  return anhyst_force_controller_conditioning_length_q31(own->inner);
}

static ANHYST_REAL ANHYST_NAME(conditioning)(const ANHYST_NAME(anhyst_force_controller) *c,
                                             int32_t tick)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  return (ANHYST_REAL)anhyst_force_controller_conditioning_q31(own->inner, tick) * own->ampere;
}

static void ANHYST_NAME(demagnetise)(ANHYST_NAME(anhyst_force_controller) *c)
{
  const ANHYST_NAME(anhyst_coded) *own = c->own;
  anhyst_force_controller_demagnetise_q31(own->inner);
}

/* Another block is one of words: the inner controller takes it itself. */
static void ANHYST_NAME(carry)(ANHYST_NAME(anhyst_force_controller) *c,
                               const ANHYST_NAME(anhyst_block) *block)
{
  (void)c;
  (void)block;
}

anhyst_status ANHYST_NAME(anhyst_force_controller_init_coded)(
    ANHYST_NAME(anhyst_force_controller) *c, ANHYST_NAME(anhyst_coded) *coded,
    const ANHYST_NAME(anhyst_code_scales) *scales, anhyst_force_controller_q31 *inner)
{
  static const ANHYST_NAME(anhyst_force_method) by_codes = {
      ANHYST_NAME(solve),  ANHYST_NAME(commit),       ANHYST_NAME(expected),
      ANHYST_NAME(length), ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  const ANHYST_NAME(anhyst_force_controller) fresh = {.method = &by_codes, .own = coded};
  const ANHYST_REAL range = scales->gap_high - scales->gap_low;
  if (!ANHYST_NAME(is_scale)(scales->demand) || !ANHYST_NAME(is_scale)(scales->current) ||
      !ANHYST_NAME(is_scale)(scales->flux) || !ANHYST_NAME(is_scale)(range)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  coded->inner = inner;
  coded->force = ANHYST_CODES / scales->demand;
  coded->current = ANHYST_CODES / scales->current;
  coded->flux = ANHYST_CODES / scales->flux;
  coded->gap = ANHYST_CODES / range;
  coded->gap_low = scales->gap_low;
  coded->newton = scales->demand / ANHYST_CODES;
  coded->ampere = scales->current / ANHYST_CODES;
  return ANHYST_OK;
}

#undef ANHYST_CODES
