/* SPDX-License-Identifier: Apache-2.0 */

static int is_in_range(ANHYST_REAL a, ANHYST_REAL range) { return a > -range && a < range; }

static int is_positive(ANHYST_REAL a) { return a >= R(0.0) && a <= R(1e30); }

static int are_settings_valid(const anhyst_coil_flux_settings_x *s)
{
  return s->gain > R(0.0) && s->gain <= R(1e30) && is_positive(s->resistance) &&
         s->range > R(0.0) && s->reach > R(0.0) && s->full > R(0.0) && s->full <= R(1e30) &&
         s->spread >= R(0.0) && s->spread <= s->resistance && is_positive(s->offset) &&
         is_positive(s->inductance) && s->lag > R(0.0) && s->lag <= R(1.0) && s->pull > R(0.0) &&
         s->pull <= R(1.0) / ANHYST_COIL_HASTE && is_positive(s->learning) && is_positive(s->large);
}

static ANHYST_REAL to_flux(ANHYST_REAL sum) { return sum; }

static ANHYST_REAL times_share(ANHYST_REAL a, ANHYST_REAL share) { return a * share; }

static ANHYST_REAL clamp(ANHYST_REAL a, ANHYST_REAL low, ANHYST_REAL high)
{
  const ANHYST_REAL above = a < high ? a : high;
  return above > low ? above : low;
}

static ANHYST_REAL law_flux(const anhyst_coil_flux_x *coil)
{
  return coil->inner->expected + coil->settings.inductance * coil->inner->correction;
}

static void start_learning(anhyst_coil_flux_x *coil)
{
  coil->resistance = coil->settings.resistance;
  coil->pull = coil->settings.pull;
}

/* Integrates the voltage of a tick. Learns offset and resistance from the drift against the law.
   Pulls the estimate to the law, and limits its deviation, if the law describes the iron. */
static void integrate_voltage(anhyst_coil_flux_x *coil, ANHYST_REAL voltage, ANHYST_REAL law,
                              int is_law_valid)
{
  const anhyst_coil_flux_settings_x *s = &coil->settings;
  const ANHYST_REAL drop = coil->resistance * coil->current;
  const ANHYST_REAL drift = s->gain * voltage - drop - coil->offset - (law - coil->law);
  const ANHYST_REAL step = coil->pull * drift;
  const ANHYST_REAL level = R(2.0) * law / s->full;
  const ANHYST_REAL teaching = is_in_range(coil->current, s->large) ? R(0.0) : coil->current;
  const ANHYST_REAL resistance = coil->resistance + s->learning * step * teaching;
  coil->offset = clamp(coil->offset + step, -s->offset, s->offset);
  coil->resistance = clamp(resistance, s->resistance - s->spread, s->resistance + s->spread);
  coil->pull = clamp(coil->pull - coil->pull * coil->pull, s->pull, R(1.0));
  coil->deviation = clamp(coil->deviation + drift, -s->full, s->full);
  if (is_law_valid) {
    coil->doubt = is_in_range(coil->deviation, s->reach) ? 0U : (uint16_t)(coil->doubt + 1U);
    coil->deviation -= (coil->pull * level * level + coil->pull - s->pull) * coil->deviation;
    if (coil->doubt >= ANHYST_COIL_DOUBT_TICKS) {
      coil->doubt = 0;
      coil->deviation = R(0.0);
      coil->pull = ANHYST_COIL_HASTE * s->pull;
    }
  }
}
