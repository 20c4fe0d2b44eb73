/* SPDX-License-Identifier: Apache-2.0 */

/* What follows is the same in every format; the few operations in which they differ stand before
   it: force_controller.c for q31, generic/force_controller_real.h for the others. */

static int ANHYST_NAME(are_limits)(ANHYST_REAL low, ANHYST_REAL high)
{
  return ANHYST_NAME(is_known)(low) && ANHYST_NAME(is_known)(high) && low <= high;
}

/* What a current that was found, and what the measured flux adds to it, are within limits. */
static ANHYST_REAL ANHYST_NAME(corrected)(ANHYST_NAME(anhyst_force_controller) *c,
                                          ANHYST_REAL current)
{
  c->wanted = ANHYST_NAME(anhyst_add)(current, c->correction);
  c->current = ANHYST_NAME(limited)(c, c->wanted);
  if (c->current != c->wanted) {
    c->flags |= ANHYST_CURRENT_LIMITED;
  }
  return c->current;
}

/* ---- by a map ---- */

static void ANHYST_NAME(take_demand)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL demand)
{
  c->solved = 1;
  c->demand = ANHYST_NAME(pulling)(c->map, demand);
  c->flags = c->demand != demand ? ANHYST_DEMAND_LIMITED : 0U;
}

static ANHYST_REAL ANHYST_NAME(solve_by_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                             ANHYST_REAL demand, ANHYST_REAL gap, ANHYST_REAL flux)
{
  (void)flux;
  ANHYST_NAME(take_demand)(c, demand);
  return ANHYST_NAME(corrected)(c, ANHYST_NAME(anhyst_map_value)(c->map, c->demand, gap));
}

/* The force of an applied current, of which the measured flux added a part. */
static ANHYST_REAL ANHYST_NAME(output_by_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                              ANHYST_REAL applied, ANHYST_REAL added,
                                              ANHYST_REAL gap)
{
  if (c->solved != 0U && applied == c->wanted) {
    return c->demand;
  }
  return ANHYST_NAME(anhyst_map_force)(c->map, ANHYST_NAME(anhyst_sub)(applied, added), gap);
}

static ANHYST_REAL ANHYST_NAME(commit_by_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                              ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL output = ANHYST_NAME(output_by_map)(c, applied, 0, gap);
  c->solved = 0;
  return output;
}

static ANHYST_REAL ANHYST_NAME(expected_by_map)(const ANHYST_NAME(anhyst_force_controller) *c,
                                                ANHYST_REAL applied, ANHYST_REAL gap)
{
  return ANHYST_NAME(anhyst_map_force)(c->map, applied, gap);
}

/* A map has no memory. */
static int32_t ANHYST_NAME(no_length)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  (void)c;
  return 0;
}

static ANHYST_REAL ANHYST_NAME(no_conditioning)(const ANHYST_NAME(anhyst_force_controller) *c,
                                                int32_t tick)
{
  (void)c;
  (void)tick;
  return 0;
}

static void ANHYST_NAME(no_iron)(ANHYST_NAME(anhyst_force_controller) *c) { (void)c; }

static void ANHYST_NAME(no_block)(ANHYST_NAME(anhyst_force_controller) *c,
                                  const ANHYST_NAME(anhyst_block) *block)
{
  (void)c;
  (void)block;
}

anhyst_status ANHYST_NAME(anhyst_force_controller_init_map)(ANHYST_NAME(anhyst_force_controller) *c,
                                                            const ANHYST_NAME(anhyst_map) *map,
                                                            ANHYST_REAL low, ANHYST_REAL high)
{
  static const ANHYST_NAME(anhyst_force_method) by_map = {
      ANHYST_NAME(solve_by_map), ANHYST_NAME(commit_by_map),   ANHYST_NAME(expected_by_map),
      ANHYST_NAME(no_length),    ANHYST_NAME(no_conditioning), ANHYST_NAME(no_iron),
      ANHYST_NAME(no_block)};
  const ANHYST_NAME(anhyst_force_controller) fresh = {0};
  if (ANHYST_NAME(anhyst_map_check)(map) != ANHYST_OK || !ANHYST_NAME(are_limits)(low, high)) {
    return ANHYST_BAD_PARAMETER;
  }
  *c = fresh;
  c->method = &by_map;
  c->map = map;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}

/* ---- by a map and the measured flux ---- */

static ANHYST_REAL ANHYST_NAME(solve_by_flux)(ANHYST_NAME(anhyst_force_controller) *c,
                                              ANHYST_REAL demand, ANHYST_REAL gap, ANHYST_REAL flux)
{
  ANHYST_NAME(take_demand)(c, demand);
  ANHYST_NAME(correct)(c, gap, flux);
  return ANHYST_NAME(corrected)(c, ANHYST_NAME(anhyst_map_value)(c->map, c->demand, gap));
}

static ANHYST_REAL ANHYST_NAME(commit_by_flux)(ANHYST_NAME(anhyst_force_controller) *c,
                                               ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL added = c->solved == 0U ? ANHYST_NAME(held)(c) : c->correction;
  const ANHYST_REAL output = ANHYST_NAME(output_by_map)(c, applied, added, gap);
  if (c->solved != 0U) {
    ANHYST_NAME(advance_flux)(c, applied);
  }
  c->solved = 0;
  return output;
}

anhyst_status ANHYST_NAME(anhyst_force_controller_init_flux)(
    ANHYST_NAME(anhyst_force_controller) *c, const ANHYST_NAME(anhyst_map) *map,
    const ANHYST_NAME(anhyst_flux_loop) *loop, ANHYST_REAL low, ANHYST_REAL high)
{
  static const ANHYST_NAME(anhyst_force_method) by_flux = {
      ANHYST_NAME(solve_by_flux), ANHYST_NAME(commit_by_flux),  ANHYST_NAME(expected_by_map),
      ANHYST_NAME(no_length),     ANHYST_NAME(no_conditioning), ANHYST_NAME(no_iron),
      ANHYST_NAME(no_block)};
  if (ANHYST_NAME(anhyst_map_check)(&loop->wanted) != ANHYST_OK || !ANHYST_NAME(is_valid)(loop) ||
      ANHYST_NAME(anhyst_force_controller_init_map)(c, map, low, high) != ANHYST_OK) {
    return ANHYST_BAD_PARAMETER;
  }
  c->method = &by_flux;
  c->loop = loop;
  return ANHYST_OK;
}

/* ---- by a compensator, or past it ---- */

static ANHYST_REAL ANHYST_NAME(solve_by_compensator)(ANHYST_NAME(anhyst_force_controller) *c,
                                                     ANHYST_REAL demand, ANHYST_REAL gap,
                                                     ANHYST_REAL flux)
{
  (void)flux;
  c->solved = 1;
  c->demand = demand;
  c->current = ANHYST_NAME(anhyst_compensator_solve)(&c->compensator, demand, gap);
  c->flags = c->compensator.flags;
  return c->current;
}

/* What the compensator expects, beside what it expected of the solved current: both have the error
   of the way back from flux to force, which must not reach the integral of whoever asked. */
static ANHYST_REAL ANHYST_NAME(commit_by_compensator)(ANHYST_NAME(anhyst_force_controller) *c,
                                                      ANHYST_REAL applied, ANHYST_REAL gap)
{
  ANHYST_NAME(anhyst_compensator) *compensator = &c->compensator;
  compensator->flux_applied = compensator->flux;
  const ANHYST_REAL solved = ANHYST_NAME(anhyst_compensator_output)(compensator);
  ANHYST_NAME(anhyst_compensator_commit)(compensator, applied, gap);
  const ANHYST_REAL output = ANHYST_NAME(anhyst_compensator_output)(compensator);
  const uint16_t other = ANHYST_DEMAND_LIMITED | ANHYST_FLUX_LIMITED;
  const int as_solved = c->solved != 0U && (c->flags & other) == 0U;
  c->solved = 0;
  return as_solved ? ANHYST_NAME(anhyst_add)(c->demand, ANHYST_NAME(anhyst_sub)(output, solved))
                   : output;
}

static ANHYST_REAL ANHYST_NAME(expected_by_compensator)(
    const ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL applied, ANHYST_REAL gap)
{
  (void)applied;
  (void)gap;
  return ANHYST_NAME(anhyst_compensator_output)(&c->compensator);
}

static int32_t ANHYST_NAME(length)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  return ANHYST_NAME(conditioning_length)(&c->compensator);
}

static ANHYST_REAL ANHYST_NAME(conditioning)(const ANHYST_NAME(anhyst_force_controller) *c,
                                             int32_t tick)
{
  return ANHYST_NAME(anhyst_conditioning)(&c->compensator, tick);
}

static void ANHYST_NAME(carry)(ANHYST_NAME(anhyst_force_controller) *c,
                               const ANHYST_NAME(anhyst_block) *block)
{
  ANHYST_NAME(swap)(&c->compensator, block);
}

const ANHYST_NAME(anhyst_force_method)
    ANHYST_NAME(anhyst_force_by_compensator) = {ANHYST_NAME(solve_by_compensator),
                                                ANHYST_NAME(commit_by_compensator),
                                                ANHYST_NAME(expected_by_compensator),
                                                ANHYST_NAME(length),
                                                ANHYST_NAME(conditioning),
                                                ANHYST_NAME(demagnetise),
                                                ANHYST_NAME(carry)};

static ANHYST_REAL ANHYST_NAME(commit_past)(ANHYST_NAME(anhyst_force_controller) *c,
                                            ANHYST_REAL applied, ANHYST_REAL gap)
{
  const ANHYST_REAL output = ANHYST_NAME(commit_by_map)(c, applied, gap);
  ANHYST_NAME(anhyst_compensator_commit)(&c->compensator, applied, gap);
  return output;
}

void ANHYST_NAME(anhyst_force_controller_bypass)(ANHYST_NAME(anhyst_force_controller) *c,
                                                 const ANHYST_NAME(anhyst_map) *map,
                                                 ANHYST_REAL low, ANHYST_REAL high)
{
  static const ANHYST_NAME(anhyst_force_method) past_compensator = {
      ANHYST_NAME(solve_by_map), ANHYST_NAME(commit_past),  ANHYST_NAME(expected_by_map),
      ANHYST_NAME(length),       ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  c->method = map != NULL ? &past_compensator : &ANHYST_NAME(anhyst_force_by_compensator);
  c->map = map;
  c->low = low;
  c->high = high;
}

/* ---- by a compensator and the measured flux ---- */

static ANHYST_REAL ANHYST_NAME(solve_fused)(ANHYST_NAME(anhyst_force_controller) *c,
                                            ANHYST_REAL demand, ANHYST_REAL gap, ANHYST_REAL flux)
{
  const ANHYST_REAL by_law = ANHYST_NAME(solve_by_compensator)(c, demand, gap, flux);
  ANHYST_NAME(correct)(c, gap, flux);
  ANHYST_NAME(bound_correction)(c);
  return ANHYST_NAME(corrected)(c, by_law);
}

/* The iron is taken for one of which the measured flux corrects the current: the compensator
   commits what is left of it. */
static ANHYST_REAL ANHYST_NAME(commit_fused)(ANHYST_NAME(anhyst_force_controller) *c,
                                             ANHYST_REAL applied, ANHYST_REAL gap)
{
  const uint16_t solved = c->solved;
  const ANHYST_REAL added = solved == 0U ? ANHYST_NAME(held)(c) : c->correction;
  const ANHYST_REAL output =
      ANHYST_NAME(commit_by_compensator)(c, ANHYST_NAME(anhyst_sub)(applied, added), gap);
  if (solved != 0U) {
    ANHYST_NAME(advance_flux)(c, applied);
    ANHYST_NAME(bound_integral)(c);
  }
  return output;
}

anhyst_status ANHYST_NAME(anhyst_force_controller_fuse)(ANHYST_NAME(anhyst_force_controller) *c,
                                                        const ANHYST_NAME(anhyst_flux_loop) *loop,
                                                        ANHYST_REAL low, ANHYST_REAL high)
{
  static const ANHYST_NAME(anhyst_force_method) fused = {
      ANHYST_NAME(solve_fused), ANHYST_NAME(commit_fused), ANHYST_NAME(expected_by_compensator),
      ANHYST_NAME(length),      ANHYST_NAME(conditioning), ANHYST_NAME(demagnetise),
      ANHYST_NAME(carry)};
  if (ANHYST_NAME(anhyst_map_check)(&loop->wanted) != ANHYST_OK || !ANHYST_NAME(is_valid)(loop) ||
      !ANHYST_NAME(are_limits)(low, high)) {
    return ANHYST_BAD_PARAMETER;
  }
  c->method = &fused;
  c->loop = loop;
  c->low = low;
  c->high = high;
  return ANHYST_OK;
}
