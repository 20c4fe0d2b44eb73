/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of the drive in fixed point, of the kinds map and flux. */
#include "anhyst/compensator/force_controller.h"

#include "check.h"
#include "maps.h"

static int16_t entries[MOST_COLUMNS * MOST_ROWS];
static int16_t densities[MOST_COLUMNS * MOST_ROWS];

static void check_tick(anhyst_force_controller_q31 *drive, int tick)
{
  const int32_t gap = any_code();
  const int32_t demand = any_code();
  const int32_t flux = tick % 5 == 0 ? ANHYST_NO_FLUX : any_code();
  const int32_t current = anhyst_force_controller_solve_q31(drive, demand, gap, flux);
  CHECK(current >= drive->low && current <= drive->high);
  CHECK(current == anhyst_force_controller_solve_q31(drive, demand, gap, flux));
  const int free = (drive->flags & ANHYST_CURRENT_LIMITED) == 0U;
  const int32_t applied = tick % 3 == 0 ? any_code() : current;
  const int32_t output = anhyst_force_controller_commit_q31(drive, applied, gap);
  CHECK(output >= 0);
  CHECK(!free || applied != current || output == (demand > 0 ? demand : 0));
}

/* Under sanitizers: no signal, gain or state makes anything overflow. */
static void any_signal_is_answered_within_the_limits(void)
{
  for (int i = 0; i < 200; i++) {
    const anhyst_map_q31 map = any_map(entries, (uint16_t)(i % 9), (uint16_t)(i % 5), 8000);
    const anhyst_factor any = {(int16_t)any_within(-32768, 32767), (int16_t)any_within(-15, 16)};
    const anhyst_flux_loop_q31 loop = {any_map(densities, 4, 2, 9000),
                                       any,
                                       {any.shift, any.shift},
                                       {(int16_t)any_within(0, 32767), 1},
                                       {(int16_t)any_within(-32768, 0), (int16_t)(i % 2)},
                                       0};
    const int32_t low = any_code() / 2;
    anhyst_force_controller_q31 drive;
    CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, low,
                                                any_within(low, ANHYST_Q31_MAX)) == ANHYST_OK);
    for (int tick = 0; tick < SIGNALS; tick++) {
      check_tick(&drive, tick);
    }
  }
}

static void invalid_drives_are_refused(void)
{
  const anhyst_map_q31 map = any_map(entries, 3, 2, 1000);
  const anhyst_factor one = {16384, 2};
  const anhyst_factor through = {-32768, 1};
  const anhyst_flux_loop_q31 valid = {any_map(densities, 3, 2, 1000), one, one, one, through, 0};
  anhyst_flux_loop_q31 loop = valid;
  anhyst_force_controller_q31 drive;
  CHECK(anhyst_force_controller_init_map_q31(&drive, &map, 1, 0) == ANHYST_BAD_PARAMETER);
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_OK);
  loop.proportional.shift = 17;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  loop = valid;
  loop.back.mantissa = -1;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  loop = valid;
  loop.smoothing.mantissa = 1;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  loop = valid;
  loop.most = -1;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  loop = valid;
  loop.wanted.entries = 0;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &valid.wanted, &valid, 1, 0) ==
        ANHYST_BAD_PARAMETER);
}

int main(void)
{
  any_signal_is_answered_within_the_limits();
  invalid_drives_are_refused();
  return verdict();
}
