/* SPDX-License-Identifier: Apache-2.0 */

anhyst_status anhyst_force_controller_init_compensator_x(anhyst_force_controller_x *c,
                                                         const anhyst_kernel_x *kernel,
                                                         const ANHYST_REAL *words,
                                                         uint32_t capacity)
{
  anhyst_force_controller_x initial = {0};
  initial.method = &anhyst_force_by_compensator_x;
  const anhyst_status status =
      anhyst_compensator_init_x(&initial.compensator, kernel, words, capacity);
  if (status == ANHYST_OK) {
    *c = initial;
  }
  return status;
}

/* Returns whether a is in -1e30..1e30. Returns 0 for NaN. */
static int is_finite(ANHYST_REAL a) { return a >= R(-1e30) && a <= R(1e30); }

static int is_flux_loop_valid(const anhyst_flux_loop_x *loop)
{
  return is_finite(loop->proportional) && is_finite(loop->integral) && loop->back >= R(0.0) &&
         loop->back <= R(1.0) && loop->smoothing > R(0.0) && loop->smoothing <= R(1.0) &&
         loop->most >= R(0.0);
}

static ANHYST_REAL limit_current(const anhyst_force_controller_x *c, ANHYST_REAL current)
{
  return anhyst_clamped_x(current, c->low, c->high);
}

/* Limits a demand to the forces of the map. Returns a force of 0 for NaN. */
static ANHYST_REAL limit_demand(const anhyst_map_x *map, ANHYST_REAL demand)
{
  const ANHYST_REAL below = demand < map->force_low ? map->force_low : R(0.0);
  return demand >= map->force_low ? anhyst_clamped_x(demand, map->force_low, map->force_high)
                                  : below;
}

static ANHYST_REAL integral_current(const anhyst_force_controller_x *c) { return c->integral; }

static int32_t compensator_conditioning_ticks(const anhyst_compensator_x *compensator)
{
  return anhyst_conditioning_length_x(compensator);
}

static void demagnetise(anhyst_force_controller_x *c)
{
  anhyst_compensator_demagnetise_x(&c->compensator);
}

static void swap_compensator_block(anhyst_compensator_x *compensator, const ANHYST_REAL *words)
{
  anhyst_compensator_swap_x(compensator, words);
}

/* Updates the current that corrects the flux error. The measured flux is compared with the flux
   that is expected in this tick, instead of the demanded flux. Expected and demanded flux differ by
   a delay, which no current can remove. */
static void update_correction(anhyst_force_controller_x *c, ANHYST_REAL gap, ANHYST_REAL flux)
{
  const anhyst_map_x *flux_table = &c->loop->flux_table;
  const int pulls = flux_table->force_low >= R(0.0);
  const ANHYST_REAL force =
      pulls ? ANHYST_SQRT(limit_demand(flux_table, c->demand) * flux_table->force_high) : c->demand;
  c->flux = anhyst_map_value_x(flux_table, force, gap);
  c->error = is_finite(flux) ? c->expected - flux : R(0.0);
  c->correction = c->loop->proportional * c->error + c->integral;
}

/* Advances the expected flux and the integral. Anti-windup acts only if a limit reduced the
   current. The error of the sensor and the lag of the amplifier also change a measured current. */
static void advance_flux_loop(anhyst_force_controller_x *c, ANHYST_REAL applied)
{
  const anhyst_flux_loop_x *loop = c->loop;
  c->expected += loop->smoothing * (c->flux - c->expected);
  c->integral += loop->integral * c->error;
  if ((c->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    c->integral += loop->back * (applied - c->unlimited_current);
  }
}

static void limit_correction(anhyst_force_controller_x *c)
{
  c->correction = anhyst_clamped_x(c->correction, -c->loop->most, c->loop->most);
}

static void limit_integral(anhyst_force_controller_x *c)
{
  c->integral = anhyst_clamped_x(c->integral, -c->loop->most, c->loop->most);
}
