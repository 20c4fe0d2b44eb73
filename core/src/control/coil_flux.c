/* SPDX-License-Identifier: Apache-2.0 */
#include "anhyst/control/coil_flux.h"

#include <stddef.h>

#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/q31.h"
#include "anhyst/numeric/wide.h"

static int is_in_range(int32_t a, int32_t range) { return a > -range && a < range; }

static int are_settings_valid(const anhyst_coil_flux_settings_q31 *s)
{
  return s->gain > 0 && s->gain <= ANHYST_COIL_MOST && s->resistance <= ANHYST_COIL_MOST &&
         s->spread >= 0 && s->spread <= s->resistance && s->offset >= 0 && s->inductance >= 0 &&
         s->lag > 0 && s->range > 0 && s->reach > 0 && s->pull > 0 &&
         s->pull <= ANHYST_Q31_MAX / ANHYST_COIL_HASTE;
}

/* Rounds a sum, q60, to q31. */
static int32_t to_flux(int64_t sum) { return anhyst_sat_wide(anhyst_rounded_shift(sum, 29)); }

static int32_t times_share(int32_t a, int32_t share) { return anhyst_product_q31(a, share); }

/* Returns the flux that the law expects at the present current. The inner flux is q30. */
static int32_t law_flux(const anhyst_coil_flux_q31 *coil)
{
  const int64_t by_correction = anhyst_wide(coil->settings.inductance, coil->inner->correction);
  return anhyst_add_q31(anhyst_shl_q31(coil->inner->expected, 1), to_flux(by_correction));
}

static void start_learning(anhyst_coil_flux_q31 *coil)
{
  coil->resistance = (int64_t)coil->settings.resistance * ((int64_t)1 << 31);
  coil->pull = coil->settings.pull;
}

/* Learns offset and resistance from the drift against the law in a tick, q60. */
static void learn(anhyst_coil_flux_q31 *coil, int64_t drift)
{
  const anhyst_coil_flux_settings_q31 *s = &coil->settings;
  const int64_t nominal = (int64_t)s->resistance * ((int64_t)1 << 31);
  const int64_t spread = (int64_t)s->spread * ((int64_t)1 << 31);
  const int32_t change = to_flux(drift);
  const int32_t teaching = is_in_range(coil->current, ANHYST_COIL_LARGE) ? 0 : coil->current;
  const int32_t by_current = anhyst_product_q31(change, teaching);
  const int64_t resistance =
      coil->resistance - nominal + (anhyst_wide(coil->pull, by_current) >> ANHYST_COIL_LEARNING);
  const int32_t square = (int32_t)(anhyst_wide(coil->pull, coil->pull) >> 35);
  const int32_t pull = anhyst_sub_q31(coil->pull, square);
  coil->offset = anhyst_clamp_wide(coil->offset + (anhyst_wide(coil->pull, change) >> 6),
                                   (int64_t)s->offset * ((int64_t)1 << 20));
  coil->resistance = nominal + anhyst_clamp_wide(resistance, spread);
  coil->pull = pull > s->pull ? pull : s->pull;
}

/* Integrates the voltage of a tick. Learns offset and resistance from the drift against the law.
   Pulls the estimate to the law, and limits its deviation, if the law describes the iron. */
static void integrate_voltage(anhyst_coil_flux_q31 *coil, int32_t voltage, int32_t law,
                              int is_law_valid)
{
  const int32_t resistance = (int32_t)anhyst_rounded_shift(coil->resistance, 31);
  const int64_t drop = anhyst_wide(resistance, coil->current);
  const int64_t law_change = (int64_t)anhyst_sub_q31(law, coil->law) * ((int64_t)1 << 29);
  const int64_t drift =
      anhyst_wide(coil->settings.gain, voltage) - drop - coil->offset - law_change;
  learn(coil, drift);
  coil->deviation = anhyst_clamp_wide(coil->deviation + drift, ANHYST_WIDE_ONE);
  if (is_law_valid) {
    const int32_t pull = anhyst_product_q31(coil->pull, anhyst_product_q31(law, law));
    const int32_t deviation = to_flux(coil->deviation);
    coil->deviation -= anhyst_wide(pull, deviation) >> 4;
    coil->deviation -= anhyst_wide(coil->pull - coil->settings.pull, deviation) >> 6;
    coil->doubt = is_in_range(deviation, coil->settings.reach) ? 0U : (uint16_t)(coil->doubt + 1U);
    if (coil->doubt >= ANHYST_COIL_DOUBT_TICKS) {
      coil->doubt = 0;
      coil->deviation = 0;
      coil->pull = coil->settings.pull * ANHYST_COIL_HASTE;
    }
  }
}

#include "generic/coil_flux.h"
