/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status anhyst_force_controller_init_compensator_x(anhyst_force_controller_x *c,
                                                         const anhyst_kernel_x *kernel,
                                                         const ANHYST_REAL *words,
                                                         uint32_t capacity)
{
  anhyst_force_controller_x found = {0};
  found.method = &anhyst_force_by_compensator_x;
  const anhyst_status status =
      anhyst_compensator_init_x(&found.compensator, kernel, words, capacity);
  if (status == ANHYST_OK) {
    *c = found;
  }
  return status;
}

/* Whether it is a number that can be reckoned with. */
static int is_known(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

static int is_valid(const anhyst_flux_loop_x *loop)
{
  return is_known(loop->proportional) && is_known(loop->integral) && loop->back >= R(0.0) &&
         loop->back <= R(1.0) && loop->smoothing > R(0.0) && loop->smoothing <= R(1.0) &&
         loop->most >= R(0.0);
}

static ANHYST_REAL limited(const anhyst_force_controller_x *c, ANHYST_REAL current)
{
  return anhyst_limited_x(current, c->low, c->high);
}

/* The nearest force of the map; none where the demand is no number. */
static ANHYST_REAL pulling(const anhyst_map_x *map, ANHYST_REAL demand)
{
  const ANHYST_REAL below = demand < map->force_low ? map->force_low : R(0.0);
  return demand >= map->force_low ? anhyst_limited_x(demand, map->force_low, map->force_high)
                                  : below;
}

/* What the integral of the measured flux adds to the current. */
static ANHYST_REAL held(const anhyst_force_controller_x *c) { return c->integral; }

static int32_t conditioning_length(const anhyst_compensator_x *compensator)
{
  return anhyst_conditioning_length_x(compensator);
}

static void demagnetise(anhyst_force_controller_x *c)
{
  anhyst_compensator_demagnetise_x(&c->compensator);
}

static void swap(anhyst_compensator_x *compensator, const ANHYST_REAL *words)
{
  anhyst_compensator_swap_x(compensator, words);
}

/* What the measured flux adds to the current. Compared is what should show by now, not what is
   wanted: the difference between those is delay, which no current removes. */
static void correct(anhyst_force_controller_x *c, ANHYST_REAL gap, ANHYST_REAL flux)
{
  const anhyst_map_x *wanted = &c->loop->wanted;
  const int pulls = wanted->force_low >= R(0.0);
  const ANHYST_REAL force =
      pulls ? ANHYST_SQRT(pulling(wanted, c->demand) * wanted->force_high) : c->demand;
  c->flux = anhyst_map_value_x(wanted, force, gap);
  c->error = is_known(flux) ? c->expected - flux : R(0.0);
  c->correction = c->loop->proportional * c->error + c->integral;
}

/* Only a limit leads the integral back: a current that was measured differs from the wanted one by
   the error of its sensor too, and by how far the amplifier is behind. */
static void advance_flux(anhyst_force_controller_x *c, ANHYST_REAL applied)
{
  const anhyst_flux_loop_x *loop = c->loop;
  c->expected += loop->smoothing * (c->flux - c->expected);
  c->integral += loop->integral * c->error;
  if ((c->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    c->integral += loop->back * (applied - c->wanted);
  }
}

/* What is added to a compensator is bounded, so that a probe that fails costs no more than that. */
static void bound_correction(anhyst_force_controller_x *c)
{
  c->correction = anhyst_limited_x(c->correction, -c->loop->most, c->loop->most);
}

static void bound_integral(anhyst_force_controller_x *c)
{
  c->integral = anhyst_limited_x(c->integral, -c->loop->most, c->loop->most);
}
