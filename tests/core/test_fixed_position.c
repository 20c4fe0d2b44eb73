/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the position controller in fixed point for random settings and signals. */
#include "anhyst/control/position.h"

#include <string.h>

#include "check.h"
#include "edges.h"
#include "maps.h"

static int16_t entries[MOST_COLUMNS * MOST_ROWS];

static anhyst_pidd2_gains_q31 any_gains(void)
{
  anhyst_pidd2_gains_q31 gains;
  gains.proportional = any_factor();
  gains.integral = any_factor();
  gains.derivative = any_factor();
  gains.second = any_factor();
  gains.load = any_factor();
  gains.back = any_factor();
  gains.back.mantissa = (int16_t)any_within(0, 32767);
  gains.smoothing.mantissa = (int16_t)any_within(-32768, 0);
  gains.smoothing.shift = (int16_t)any_within(0, 1);
  gains.smoothing_2 = gains.smoothing;
  gains.unweighted = (int16_t)any_within(-32768, 0);
  gains.reserved = 0;
  gains.low = any_code();
  gains.high = any_within(gains.low, ANHYST_Q31_MAX);
  return gains;
}

static anhyst_position_limits_q31 any_limits(void)
{
  anhyst_position_limits_q31 limits;
  limits.levitation.low = any_within(ANHYST_Q31_MIN, ANHYST_Q31_MAX - 1);
  limits.levitation.high = any_within(limits.levitation.low + 1, ANHYST_Q31_MAX);
  limits.levitation.step = any_within(1, ANHYST_Q31_MAX);
  limits.levitation.max_missing_samples = (uint16_t)any_within(0, 4);
  limits.levitation.hold = (uint16_t)any_within(0, 40);
  limits.levitation.selftest = (uint16_t)any_within(1, 4);
  /* Limits of a range of up to all numbers, with steps from one code up to the whole range. */
  limits.current_step = any_within(1, 1 << any_within(0, 30));
  limits.current_low = any_within(ANHYST_Q31_MIN, ANHYST_Q31_MAX / 4);
  const uint32_t most =
      (0x7FFFFFFFU - (uint32_t)limits.current_low) / (uint32_t)limits.current_step;
  limits.current_high =
      (int32_t)((uint32_t)limits.current_low + most * (uint32_t)limits.current_step);
  limits.release = any_within(limits.current_step, ANHYST_Q31_MAX);
  return limits;
}

static anhyst_position_settings_q31 any_settings(void)
{
  anhyst_position_settings_q31 settings;
  settings.levitation.detect = any_within(1, 1 << any_within(0, 30));
  settings.levitation.rise = any_within(1, ANHYST_Q31_MAX);
  settings.levitation.descend = any_within(1, ANHYST_Q31_MAX);
  settings.levitation.lift = any_within(1, 1 << any_within(0, 30));
  settings.levitation.set_down = any_within(1, ANHYST_Q31_MAX);
  settings.levitation.most = any_within(1, ANHYST_Q31_MAX);
  settings.levitation.press = any_within(ANHYST_Q31_MIN, 0);
  settings.gains = any_gains();
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    settings.units.gap[i].offset = any_code();
    settings.units.gap[i].factor = any_factor();
  }
  settings.bias = any_code();
  settings.measured = (uint16_t)any_within(0, 1);
  settings.plain = NULL;
  return settings;
}

/* Most positions are plausible, so that the controller reaches every state. */
static anhyst_position_sample_q31 any_sample(const anhyst_position_limits_q31 *limits, int tick)
{
  anhyst_position_sample_q31 sample;
  sample.position = any_within(limits->levitation.low, limits->levitation.high);
  if (tick % 11 == 0) {
    sample.position = edge_number(any_within(0, EDGE_COUNT - 1));
  }
  sample.target = any_code();
  sample.load = edge_number(any_within(0, EDGE_COUNT - 1));
  for (int i = 0; i < ANHYST_POSITION_MAGNETS; i++) {
    sample.current[i] = any_code();
    sample.flux[i] = any_code();
  }
  sample.dropped = (uint16_t)(any_within(0, 7) == 0);
  sample.command = (uint16_t)(tick % 3 == 0 ? any_within(0, 8) : 0);
  return sample;
}

static int is_drivable(const anhyst_position_limits_q31 *limits, int32_t current)
{
  const uint32_t above = (uint32_t)current - (uint32_t)limits->current_low;
  return current >= limits->current_low && current <= limits->current_high &&
         above % (uint32_t)limits->current_step == 0U;
}

static long seen[8]; /* ticks in each phase */

/* Runs one controller with random signals. */
static void run(anhyst_position_q31 *controller, const anhyst_position_limits_q31 *limits, int pair)
{
  for (int tick = 0; tick < SIGNALS; tick++) {
    const anhyst_position_sample_q31 sample = any_sample(limits, tick);
    anhyst_position_answer_q31 answer;
    anhyst_position_tick_q31(controller, &sample, &answer);
    CHECK(is_drivable(limits, answer.current[0]));
    CHECK(pair ? is_drivable(limits, answer.current[1]) : answer.current[1] == 0);
    CHECK(answer.state / 16U <= ANHYST_STATE_FAULT);
    seen[answer.state % 8U]++;
  }
}

/* With sanitizers: nothing overflows, and no current leaves its limits or the converter's grid. */
static void any_signal_gives_a_current_within_limits(void)
{
  for (int i = 0; i < 3000; i++) {
    const anhyst_map_q31 map = any_map(entries, (uint16_t)(i % 5), (uint16_t)(i % 3), 8000);
    const anhyst_position_limits_q31 limits = any_limits();
    const anhyst_position_settings_q31 settings = any_settings();
    anhyst_force_controller_q31 magnet[2];
    anhyst_position_q31 controller;
    const int pair = i % 2;
    CHECK(anhyst_force_controller_init_map_q31(&magnet[0], &map, ANHYST_Q31_MIN, any_code()) ==
          ANHYST_OK);
    CHECK(anhyst_force_controller_init_map_q31(&magnet[1], &map, 0, ANHYST_Q31_MAX) == ANHYST_OK);
    CHECK(anhyst_position_init_q31(&controller, &limits, &settings, &magnet[0],
                                   pair ? &magnet[1] : 0) == ANHYST_OK);
    run(&controller, &limits, pair);
  }
  for (unsigned phase = ANHYST_PHASE_REST; phase <= ANHYST_PHASE_FALL; phase++) {
    CHECK(seen[phase] > 500);
  }
}

static int16_t entries_of_one[MOST_COLUMNS * MOST_ROWS];

/* Returns whether these are rejected without a change of the controller. */
static int are_refused(const anhyst_position_limits_q31 *limits,
                       const anhyst_position_settings_q31 *settings)
{
  const anhyst_map_q31 map = any_map(entries_of_one, 3, 2, 1000);
  anhyst_force_controller_q31 drive;
  anhyst_position_q31 controller;
  anhyst_position_q31 untouched;
  memset(&controller, 0x55, sizeof controller);
  memcpy(&untouched, &controller, sizeof controller);
  CHECK(anhyst_force_controller_init_map_q31(&drive, &map, 0, 1) == ANHYST_OK);
  return anhyst_position_init_q31(&controller, limits, settings, &drive, 0) ==
             ANHYST_BAD_PARAMETER &&
         memcmp(&controller, &untouched, sizeof controller) == 0;
}

static void invalid_limits_are_refused(void)
{
  const anhyst_position_settings_q31 settings = any_settings();
  anhyst_position_limits_q31 valid = any_limits();
  anhyst_position_limits_q31 wrong[7];
  valid.current_low = -1000;
  valid.current_high = 1000;
  valid.current_step = 10;
  valid.release = 10;
  CHECK(!are_refused(&valid, &settings));
  for (int i = 0; i < 7; i++) {
    wrong[i] = valid;
  }
  wrong[0].current_step = 0;
  wrong[1].current_step = 7;
  wrong[2].current_low = 1000;
  wrong[3].release = 9;
  wrong[4].levitation.step = 0;
  wrong[5].levitation.selftest = 0;
  wrong[6].levitation.high = valid.levitation.low;
  for (int i = 0; i < 7; i++) {
    CHECK(are_refused(&wrong[i], &settings));
  }
}

static void invalid_settings_are_refused(void)
{
  const anhyst_position_limits_q31 limits = any_limits();
  const anhyst_position_settings_q31 valid = any_settings();
  anhyst_position_settings_q31 wrong[9];
  CHECK(!are_refused(&limits, &valid));
  for (int i = 0; i < 9; i++) {
    wrong[i] = valid;
  }
  wrong[0].units.gap[0].factor.shift = 17;
  wrong[1].gains.low = ANHYST_Q31_MAX;
  wrong[1].gains.high = 0;
  wrong[2].levitation.detect = 0;
  wrong[3].levitation.rise = 0;
  wrong[4].levitation.descend = -1;
  wrong[5].levitation.lift = 0;
  wrong[6].levitation.set_down = 0;
  wrong[7].levitation.most = 0;
  wrong[8].levitation.press = 1;
  for (int i = 0; i < 9; i++) {
    CHECK(are_refused(&limits, &wrong[i]));
  }
  anhyst_map_q31 plain = any_map(entries, 3, 0, 1000);
  wrong[0] = valid;
  wrong[0].plain = &plain;
  CHECK(!are_refused(&limits, &wrong[0]));
  plain.force_segments = ANHYST_MAP_FORCE_SEGMENTS + 1;
  CHECK(are_refused(&limits, &wrong[0]));
}

static void compensation_stays_on_without_a_simple_map(void)
{
  const anhyst_map_q31 map = any_map(entries, 3, 2, 1000);
  const anhyst_position_limits_q31 limits = any_limits();
  const anhyst_position_settings_q31 settings = any_settings();
  anhyst_force_controller_q31 magnet;
  anhyst_position_q31 controller;
  CHECK(anhyst_force_controller_init_map_q31(&magnet, &map, 0, 1) == ANHYST_OK);
  magnet.method = &anhyst_force_by_compensator_q31;
  CHECK(anhyst_position_init_q31(&controller, &limits, &settings, &magnet, 0) == ANHYST_OK);
  CHECK(anhyst_position_compensate_q31(&controller, 0) == ANHYST_BAD_PARAMETER);
  CHECK(anhyst_position_compensate_q31(&controller, 1) == ANHYST_OK);
  CHECK(magnet.method == &anhyst_force_by_compensator_q31 && magnet.map == &map);
}

/* With sanitizers, from any state: without saturation, the demanded output of the next tick is
   exactly the same, and invalid gains are rejected. */
static void change_of_gains_is_bumpless(void)
{
  long same = 0;
  for (int i = 0; i < 20000; i++) {
    const anhyst_map_q31 map = any_map(entries, 2, 0, 1000);
    const anhyst_position_limits_q31 limits = any_limits();
    anhyst_position_settings_q31 settings = any_settings();
    anhyst_force_controller_q31 magnet;
    anhyst_position_q31 controller;
    settings.measured = (uint16_t)(i % 2);
    CHECK(anhyst_force_controller_init_map_q31(&magnet, &map, 0, ANHYST_Q31_MAX) == ANHYST_OK);
    CHECK(anhyst_position_init_q31(&controller, &limits, &settings, &magnet, 0) == ANHYST_OK);
    controller.levitation.phase = ANHYST_PHASE_HOVER;
    controller.levitation.reference = any_code() / 1024;
    controller.position = any_code() / 1024;
    controller.state.integral = any_code() / 16;
    controller.candidate.next = controller.state;
    controller.pending = (uint16_t)(i % 2);
    anhyst_position_settings_q31 other = settings;
    other.gains = any_gains();
    anhyst_pidd2_state_q31 *state =
        controller.pending != 0U ? &controller.candidate.next : &controller.state;
    anhyst_pidd2_candidate_q31 before;
    anhyst_pidd2_candidate_q31 after;
    (void)anhyst_pidd2_solve_q31(&settings.gains, state, controller.levitation.reference,
                                 controller.position, 0, &before);
    CHECK(anhyst_position_retune_q31(&controller, &other) == ANHYST_OK);
    CHECK(controller.settings == &other);
    (void)anhyst_pidd2_solve_q31(&other.gains, state, controller.levitation.reference,
                                 controller.position, 0, &after);
    same += before.unlimited_output == after.unlimited_output;
    anhyst_position_settings_q31 wrong = other;
    wrong.gains.second.shift = 17;
    CHECK(anhyst_position_retune_q31(&controller, &wrong) == ANHYST_BAD_PARAMETER);
    CHECK(controller.settings == &other);
  }
  CHECK(same > 10000);
}

/* A new method, as another project would write it. The method calls a force controller with any
   other method. */
static int32_t solve_by_other(anhyst_force_controller_q31 *c, int32_t demand, int32_t gap,
                              int32_t flux)
{
  anhyst_force_controller_q31 *other = c->own;
  const int32_t current = anhyst_force_controller_solve_q31(other, demand, gap, flux);
  c->flags = other->flags;
  return current;
}

static int32_t other_commit(anhyst_force_controller_q31 *c, int32_t applied, int32_t gap)
{
  return anhyst_force_controller_commit_q31(c->own, applied, gap);
}

static int32_t other_expected(const anhyst_force_controller_q31 *c, int32_t applied, int32_t gap)
{
  return anhyst_force_controller_expected_q31(c->own, applied, gap);
}

static int32_t other_length(const anhyst_force_controller_q31 *c)
{
  return anhyst_force_controller_conditioning_length_q31(c->own);
}

static int32_t other_conditioning(const anhyst_force_controller_q31 *c, int32_t tick)
{
  return anhyst_force_controller_conditioning_q31(c->own, tick);
}

static void other_demagnetise(anhyst_force_controller_q31 *c)
{
  anhyst_force_controller_demagnetise_q31(c->own);
}

static void other_transfer(anhyst_force_controller_q31 *c, const int16_t *words)
{
  anhyst_force_controller_carry_q31(c->own, words);
}

static void method_of_another_project_controls_a_position(void)
{
  const anhyst_force_method_q31 by_other = {solve_by_other, other_commit,       other_expected,
                                            other_length,   other_conditioning, other_demagnetise,
                                            other_transfer};
  const anhyst_map_q31 map = any_map(entries, 3, 2, 6000);
  for (int i = 0; i < 100; i++) {
    const anhyst_position_limits_q31 limits = any_limits();
    const anhyst_position_settings_q31 settings = any_settings();
    anhyst_force_controller_q31 magnet;
    anhyst_position_q31 controller;
    CHECK(anhyst_force_controller_init_map_q31(&magnet, &map, 0, ANHYST_Q31_MAX) == ANHYST_OK);
    anhyst_force_controller_q31 other = magnet;
    anhyst_force_controller_q31 own = {.method = &by_other, .own = &other};
    anhyst_position_q31 with_own;
    CHECK(anhyst_position_init_q31(&controller, &limits, &settings, &magnet, 0) == ANHYST_OK);
    CHECK(anhyst_position_init_q31(&with_own, &limits, &settings, &own, 0) == ANHYST_OK);
    for (int tick = 0; tick < SIGNALS; tick++) {
      const anhyst_position_sample_q31 sample = any_sample(&limits, tick);
      anhyst_position_answer_q31 answer;
      anhyst_position_answer_q31 by_own;
      anhyst_position_tick_q31(&controller, &sample, &answer);
      anhyst_position_tick_q31(&with_own, &sample, &by_own);
      CHECK(answer.current[0] == by_own.current[0] && answer.demand == by_own.demand &&
            answer.flags == by_own.flags && answer.state == by_own.state);
    }
  }
}

int main(void)
{
  method_of_another_project_controls_a_position();
  any_signal_gives_a_current_within_limits();
  invalid_limits_are_refused();
  invalid_settings_are_refused();
  compensation_stays_on_without_a_simple_map();
  change_of_gains_is_bumpless();
  return verdict();
}
