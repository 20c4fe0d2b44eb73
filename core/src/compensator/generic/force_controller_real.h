/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status ANHYST_NAME(anhyst_force_controller_init_compensator)(
    ANHYST_NAME(anhyst_force_controller) *c, const ANHYST_NAME(anhyst_parameters) *parameters)
{
  ANHYST_NAME(anhyst_force_controller) found = {0};
  found.method = &ANHYST_NAME(anhyst_force_by_compensator);
  const anhyst_status status = ANHYST_NAME(anhyst_compensator_init)(&found.compensator, parameters);
  if (status == ANHYST_OK) {
    *c = found;
  }
  return status;
}

/* Whether it is a number that can be reckoned with. */
static int ANHYST_NAME(is_known)(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

static int ANHYST_NAME(is_valid)(const ANHYST_NAME(anhyst_flux_loop) *loop)
{
  return ANHYST_NAME(is_known)(loop->proportional) && ANHYST_NAME(is_known)(loop->integral) &&
         loop->back >= R(0.0) && loop->back <= R(1.0) && loop->smoothing > R(0.0) &&
         loop->smoothing <= R(1.0) && loop->most >= R(0.0);
}

static ANHYST_REAL ANHYST_NAME(limited)(const ANHYST_NAME(anhyst_force_controller) *c,
                                        ANHYST_REAL current)
{
  return ANHYST_NAME(anhyst_limited)(current, c->low, c->high);
}

/* The nearest force of the map; none where the demand is no number. */
static ANHYST_REAL ANHYST_NAME(pulling)(const ANHYST_NAME(anhyst_map) *map, ANHYST_REAL demand)
{
  const ANHYST_REAL below = demand < map->force_low ? map->force_low : R(0.0);
  return demand >= map->force_low
             ? ANHYST_NAME(anhyst_limited)(demand, map->force_low, map->force_high)
             : below;
}

/* What the integral of the measured flux adds to the current. */
static ANHYST_REAL ANHYST_NAME(held)(const ANHYST_NAME(anhyst_force_controller) *c)
{
  return c->integral;
}

static int32_t ANHYST_NAME(conditioning_length)(const ANHYST_NAME(anhyst_compensator) *compensator)
{
  return ANHYST_NAME(anhyst_conditioning_length)(compensator);
}

static void ANHYST_NAME(demagnetise)(ANHYST_NAME(anhyst_force_controller) *c)
{
  const ANHYST_NAME(anhyst_memory) demagnetised = {{R(0.0), R(0.0), R(0.0), R(0.0), R(0.0)}};
  c->compensator.memory = demagnetised;
  for (uint16_t i = 0; i < ANHYST_CELLS; i++) {
    c->compensator.plays[i] = R(0.0);
  }
#if ANHYST_MEMORIES > 1
  static const ANHYST_NAME(anhyst_deeper) none;
  for (uint16_t i = 0; i < ANHYST_MEMORIES - 1U; i++) {
    c->compensator.deeper[i] = none;
  }
#endif
  c->compensator.solved = 0;
}

static void ANHYST_NAME(swap)(ANHYST_NAME(anhyst_compensator) *compensator,
                              const ANHYST_NAME(anhyst_parameters) *parameters)
{
  ANHYST_NAME(anhyst_compensator_swap)(compensator, parameters);
}

/* What the measured flux adds to the current. Compared is what should show by now, not what is
   wanted: the difference between those is delay, which no current removes. */
static void ANHYST_NAME(correct)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL gap,
                                 ANHYST_REAL flux)
{
  const ANHYST_NAME(anhyst_map) *wanted = &c->loop->wanted;
  const int pulls = wanted->force_low >= R(0.0);
  const ANHYST_REAL force =
      pulls ? ANHYST_SQRT(ANHYST_NAME(pulling)(wanted, c->demand) * wanted->force_high) : c->demand;
  c->flux = ANHYST_NAME(anhyst_map_value)(wanted, force, gap);
  c->error = ANHYST_NAME(is_known)(flux) ? c->expected - flux : R(0.0);
  c->correction = c->loop->proportional * c->error + c->integral;
}

/* Only a limit leads the integral back: a current that was measured differs from the wanted one by
   the error of its sensor too, and by how far the amplifier is behind. */
static void ANHYST_NAME(advance_flux)(ANHYST_NAME(anhyst_force_controller) *c, ANHYST_REAL applied)
{
  const ANHYST_NAME(anhyst_flux_loop) *loop = c->loop;
  c->expected += loop->smoothing * (c->flux - c->expected);
  c->integral += loop->integral * c->error;
  if ((c->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    c->integral += loop->back * (applied - c->wanted);
  }
}

/* What is added to a compensator is bounded, so that a probe that fails costs no more than that. */
static void ANHYST_NAME(bound_correction)(ANHYST_NAME(anhyst_force_controller) *c)
{
  c->correction = ANHYST_NAME(anhyst_limited)(c->correction, -c->loop->most, c->loop->most);
}

static void ANHYST_NAME(bound_integral)(ANHYST_NAME(anhyst_force_controller) *c)
{
  c->integral = ANHYST_NAME(anhyst_limited)(c->integral, -c->loop->most, c->loop->most);
}
