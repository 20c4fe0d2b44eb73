/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_controller.h"

#include "anhyst/numeric/q31.h"

#include <stddef.h>

static int is_finite(int32_t a)
{
  (void)a;
  return 1; /* every code is finite */
}

static int is_flux_loop_valid(const anhyst_flux_loop_q31 *loop)
{
  return anhyst_factor_is_valid(loop->proportional) && anhyst_factor_is_valid(loop->integral) &&
         anhyst_factor_is_valid(loop->back) && loop->back.mantissa >= 0 &&
         anhyst_factor_is_share(loop->smoothing) && loop->most >= 0;
}

static int32_t limit_current(const anhyst_force_controller_q31 *c, int32_t current)
{
  return anhyst_clamp(current, c->low, c->high);
}

/* Limits a demand to the forces of the map: from 0 to the largest code, the last column. */
static int32_t limit_demand(const anhyst_map_q31 *map, int32_t demand)
{
  (void)map;
  return demand > 0 ? demand : 0;
}

/* Returns the current from the integral of the flux error. */
static int32_t integral_current(const anhyst_force_controller_q31 *c)
{
  return anhyst_shl_q31(c->integral, 1);
}

static int32_t compensator_conditioning_ticks(const anhyst_compensator *compensator)
{
  return anhyst_conditioning_length(compensator);
}

static void demagnetise(anhyst_force_controller_q31 *c)
{
  anhyst_compensator_demagnetise(&c->compensator);
}

static void swap_compensator_block(anhyst_compensator *compensator, const int16_t *words)
{
  anhyst_compensator_swap(compensator, words);
}

/* Updates the current that corrects the flux error. The measured flux is compared with the flux
   that is expected in this tick, instead of the demanded flux. Expected and demanded flux differ by
   a delay, which no current can remove. Fluxes are halved, so that no difference overflows. */
static void update_correction(anhyst_force_controller_q31 *c, int32_t gap, int32_t flux)
{
  c->flux = anhyst_map_value_q31(&c->loop->flux_table, anhyst_root_q31(c->demand), gap) >> 1;
  c->error = flux == ANHYST_NO_FLUX ? 0 : c->expected - (flux >> 1);
  const int32_t half =
      anhyst_add_q31(c->integral, anhyst_factor_product(c->error, c->loop->proportional));
  c->correction = anhyst_shl_q31(half, 1);
}

/* Advances the expected flux and the integral. Anti-windup acts only if a limit reduced the
   current. The error of the sensor and the lag of the amplifier also change a measured current. */
static void advance_flux_loop(anhyst_force_controller_q31 *c, int32_t applied)
{
  const anhyst_flux_loop_q31 *loop = c->loop;
  const int32_t flux_lag = c->expected - c->flux;
  int32_t integral_change = anhyst_factor_product(c->error, loop->integral);
  if ((c->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    const int32_t cut_current = (applied >> 1) - (c->unlimited_current >> 1);
    integral_change =
        anhyst_add_q31(integral_change, anhyst_factor_product(cut_current, loop->back));
  }
  c->expected += anhyst_factor_product(flux_lag, loop->smoothing);
  c->integral = anhyst_add_q31(c->integral, integral_change);
}

/* Limits the correction of a compensator's current, to limit the effect of a failed flux probe. */
static void limit_correction(anhyst_force_controller_q31 *c)
{
  c->correction = anhyst_clamp(c->correction, -c->loop->most, c->loop->most);
}

static void limit_integral(anhyst_force_controller_q31 *c)
{
  c->integral = anhyst_clamp(c->integral, -(c->loop->most >> 1), c->loop->most >> 1);
}

#include "generic/force_controller.h"

anhyst_status anhyst_force_controller_init_compensator_q31(anhyst_force_controller_q31 *c,
                                                           const anhyst_kernel *kernel,
                                                           const int16_t *words, uint16_t capacity)
{
  anhyst_force_controller_q31 initial = {0};
  initial.method = &anhyst_force_by_compensator_q31;
  const anhyst_status status =
      anhyst_compensator_init(&initial.compensator, kernel, words, capacity);
  if (status == ANHYST_OK) {
    *c = initial;
  }
  return status;
}
