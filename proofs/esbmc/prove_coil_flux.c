/* SPDX-License-Identifier: Apache-2.0 */
/* Proves a step of the flux estimator. The step begins in any state within its bounds. Settings,
   voltage and flux of the law have any valid values. No sum overflows, and the state stays within
   its bounds. */
#include "any.h"

#include "control/coil_flux.c"

#include "wide.h"

static int is_state_valid(const anhyst_coil_flux_q31 *coil)
{
  const anhyst_coil_flux_settings_q31 *s = &coil->settings;
  const int64_t most = (int64_t)s->offset * ((int64_t)1 << 20);
  return coil->deviation >= -2 * ANHYST_WIDE_ONE && coil->deviation <= 2 * ANHYST_WIDE_ONE &&
         coil->offset >= -most && coil->offset <= most && coil->resistance >= -ANHYST_WIDE_ONE &&
         coil->resistance <= ANHYST_WIDE_ONE && coil->pull >= s->pull &&
         coil->doubt < ANHYST_COIL_DOUBT_TICKS;
}

int main(void)
{
  anhyst_coil_flux_q31 coil = {0};
  const anhyst_coil_flux_settings_q31 settings = {nondet_i32(), nondet_i32(), nondet_i32(),
                                                  nondet_i32(), nondet_i32(), nondet_i32(),
                                                  nondet_i32(), nondet_i32(), nondet_i32()};
  coil.settings = settings;
  coil.deviation = nondet_i64();
  coil.offset = nondet_i64();
  coil.resistance = nondet_i64();
  coil.current = nondet_i32();
  coil.law = nondet_i32();
  coil.pull = nondet_i32();
  coil.doubt = nondet_u16();
  ASSUME(are_settings_valid(&settings));
  ASSUME(is_state_valid(&coil));
  integrate_voltage(&coil, nondet_i32(), nondet_i32(), nondet_i32() > 0);
  SHOW(is_state_valid(&coil));
  return 0;
}
