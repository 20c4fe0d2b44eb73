/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/compensator/force_controller.h"

#include "anhyst/numeric/q31.h"

#include <stddef.h>

static int is_known(int32_t a)
{
  (void)a;
  return 1; /* every code is a number */
}

static int is_valid(const anhyst_flux_loop_q31 *loop)
{
  return anhyst_factor_is_valid(loop->proportional) && anhyst_factor_is_valid(loop->integral) &&
         anhyst_factor_is_valid(loop->back) && loop->back.mantissa >= 0 &&
         anhyst_factor_is_share(loop->smoothing) && loop->most >= 0;
}

static int32_t limited(const anhyst_force_controller_q31 *c, int32_t current)
{
  return anhyst_clamp(current, c->low, c->high);
}

/* The nearest force of the map, which only pulls; the largest code is its last column. */
static int32_t pulling(const anhyst_map_q31 *map, int32_t demand)
{
  (void)map;
  return demand > 0 ? demand : 0;
}

/* What the integral of the measured flux adds to the current. */
static int32_t held(const anhyst_force_controller_q31 *c) { return anhyst_shl_q31(c->integral, 1); }

static int32_t conditioning_length(const anhyst_compensator *compensator)
{
  return anhyst_conditioning_length(compensator);
}

static void demagnetise(anhyst_force_controller_q31 *c)
{
  anhyst_compensator_demagnetise(&c->compensator);
}

static void swap(anhyst_compensator *compensator, const int16_t *words)
{
  anhyst_compensator_swap(compensator, words);
}

/* What the measured flux adds to the current. Compared is what should show by now, not what is
   wanted: the difference between those is delay, which no current removes. Halved, so that no
   difference leaves the format. */
static void correct(anhyst_force_controller_q31 *c, int32_t gap, int32_t flux)
{
  c->flux = anhyst_map_value_q31(&c->loop->wanted, anhyst_root_q31(c->demand), gap) >> 1;
  c->error = flux == ANHYST_NO_FLUX ? 0 : c->expected - (flux >> 1);
  const int32_t half =
      anhyst_add_q31(c->integral, anhyst_factor_product(c->error, c->loop->proportional));
  c->correction = anhyst_shl_q31(half, 1);
}

/* Only a limit leads the integral back: a current that was measured differs from the wanted one by
   the error of its sensor too, and by how far the amplifier is behind. */
static void advance_flux(anhyst_force_controller_q31 *c, int32_t applied)
{
  const anhyst_flux_loop_q31 *loop = c->loop;
  const int32_t behind = c->expected - c->flux;
  int32_t learnt = anhyst_factor_product(c->error, loop->integral);
  if ((c->flags & ANHYST_CURRENT_LIMITED) != 0U) {
    const int32_t missing = (applied >> 1) - (c->wanted >> 1);
    learnt = anhyst_add_q31(learnt, anhyst_factor_product(missing, loop->back));
  }
  c->expected += anhyst_factor_product(behind, loop->smoothing);
  c->integral = anhyst_add_q31(c->integral, learnt);
}

/* What is added to a compensator is bounded, so that a probe that fails costs no more than that. */
static void bound_correction(anhyst_force_controller_q31 *c)
{
  c->correction = anhyst_clamp(c->correction, -c->loop->most, c->loop->most);
}

static void bound_integral(anhyst_force_controller_q31 *c)
{
  c->integral = anhyst_clamp(c->integral, -(c->loop->most >> 1), c->loop->most >> 1);
}

#include "generic/force_controller.h"

anhyst_status anhyst_force_controller_init_compensator_q31(anhyst_force_controller_q31 *c,
                                                           const anhyst_kernel *kernel,
                                                           const int16_t *words, uint16_t capacity)
{
  anhyst_force_controller_q31 found = {0};
  found.method = &anhyst_force_by_compensator_q31;
  const anhyst_status status = anhyst_compensator_init(&found.compensator, kernel, words, capacity);
  if (status == ANHYST_OK) {
    *c = found;
  }
  return status;
}
