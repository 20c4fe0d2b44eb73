/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the fixed-point force controller: the methods map and flux, and a compensator fused
   with the measured flux. */
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

/* With sanitizers: no signal, gain or state causes an overflow. */
static void any_signal_gives_a_current_within_limits(void)
{
  for (int i = 0; i < 200; i++) {
    const anhyst_map_q31 map = any_map(entries, (uint16_t)(i % 9), (uint16_t)(i % 5), 8000);
    const anhyst_factor any = any_factor();
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

/* An iron whose field is proportional to its flux, without hysteresis. */
static int32_t linear_field(anhyst_compensator *c) { return c->flux - (c->flux >> 2); }

static int32_t linear_flux(anhyst_compensator *c, int32_t current)
{
  return anhyst_clamp(anhyst_sub_q31(current, c->arms.bias), -ANHYST_Q30_ONE, ANHYST_Q30_ONE);
}

static const anhyst_kernel straight = {.field = linear_field, .flux = linear_flux};

/* A compensator of an iron with a straight curve, with random valid numbers in its block header. */
static anhyst_force_controller_q31 any_compensated(int16_t *words)
{
  static const int tables[] = {ANHYST_WORD_GAP_GAIN, ANHYST_WORD_GAP_OFFSET, ANHYST_WORD_GAP_BIAS,
                               ANHYST_WORD_GAP_FLUX_ARM, ANHYST_WORD_GAP_FIELD_ARM};
  anhyst_force_controller_q31 drive = {.method = &anhyst_force_by_compensator_q31};
  words[ANHYST_WORD_POWER] = (int16_t)any_within(1, 2);
  words[ANHYST_WORD_DEMAND_LOW] = (int16_t)any_within(-32768, 0);
  words[ANHYST_WORD_DEMAND_HIGH] = (int16_t)any_within(0, 32767);
  words[ANHYST_WORD_CURRENT_LOW] = (int16_t)any_within(-32768, 0);
  words[ANHYST_WORD_CURRENT_HIGH] = (int16_t)any_within(0, 32767);
  words[ANHYST_WORD_CURRENT_SHIFT] = (int16_t)any_within(0, 8);
  words[ANHYST_WORD_FLUX_LIMIT] = (int16_t)any_within(1, 16384);
  words[ANHYST_WORD_FLUX_SHIFT] = (int16_t)any_within(0, 6);
  words[ANHYST_WORD_GAP_SEGMENTS] = 0;
  words[ANHYST_WORD_ROOT_KNEE] = (int16_t)any_within(2, 8);
  for (int i = 0; i < 5; i++) {
    const int first = ANHYST_BLOCK_LEAST_WORDS + 2 * i;
    const int least = tables[i] == ANHYST_WORD_GAP_GAIN || tables[i] == ANHYST_WORD_GAP_FIELD_ARM;
    words[tables[i]] = (int16_t)first;
    words[first] = (int16_t)any_within(least ? 1 : -16383, 16384);
    words[first + 1] = (int16_t)any_within(least ? 1 : -16383, 16384);
  }
  drive.compensator.kernel = &straight;
  drive.compensator.words = words;
  return drive;
}

static void check_fused_tick(anhyst_force_controller_q31 *drive, int tick)
{
  const int32_t most = drive->loop->most;
  const int32_t gap = any_code();
  const int32_t demand = any_code();
  const int32_t flux = tick % 5 == 0 ? ANHYST_NO_FLUX : any_code();
  const int32_t current = anhyst_force_controller_solve_q31(drive, demand, gap, flux);
  const int64_t added = (int64_t)drive->unlimited_current - drive->compensator.current;
  CHECK(current >= drive->low && current <= drive->high);
  CHECK(added >= -(int64_t)most && added <= most);
  CHECK(current == anhyst_force_controller_solve_q31(drive, demand, gap, flux));
  (void)anhyst_force_controller_commit_q31(drive, tick % 3 == 0 ? any_code() : current, gap);
  CHECK(drive->integral >= -(most >> 1) && drive->integral <= most >> 1);
}

/* With sanitizers, as above. */
static void probe_correction_is_bounded(void)
{
  for (int i = 0; i < 200; i++) {
    int16_t words[ANHYST_BLOCK_LEAST_WORDS + 10] = {0};
    const anhyst_flux_loop_q31 loop = {any_map(densities, 4, 2, 9000),
                                       any_factor(),
                                       any_factor(),
                                       {(int16_t)any_within(0, 32767), 1},
                                       {(int16_t)any_within(-32768, 0), (int16_t)(i % 2)},
                                       any_within(0, i % 3 == 0 ? ANHYST_Q31_MAX : 1 << 28)};
    const int32_t low = any_code() / 2;
    const int32_t high = any_within(low, ANHYST_Q31_MAX);
    anhyst_force_controller_q31 drive = any_compensated(words);
    CHECK(anhyst_force_controller_fuse_q31(&drive, &loop, low, high) == ANHYST_OK);
    for (int tick = 0; tick < SIGNALS; tick++) {
      check_fused_tick(&drive, tick);
    }
    CHECK(anhyst_force_controller_fuse_q31(&drive, &loop, 1, 0) == ANHYST_BAD_PARAMETER);
    CHECK(drive.low == low && drive.high == high);
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
  loop.flux_table.entries = 0;
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &map, &loop, 0, 1) == ANHYST_BAD_PARAMETER);
  CHECK(anhyst_force_controller_init_flux_q31(&drive, &valid.flux_table, &valid, 1, 0) ==
        ANHYST_BAD_PARAMETER);
}

int main(void)
{
  any_signal_gives_a_current_within_limits();
  probe_correction_is_bounded();
  invalid_drives_are_refused();
  return verdict();
}
