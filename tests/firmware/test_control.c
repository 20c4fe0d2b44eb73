/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the control task: states, faults with their reasons, safe state, force controller.
 */
#include "../core/check.h"
#include "bench.h"

static const app_control *control(void) { return &bench.firmware.control; }
static const anhyst_supervisor *states(void) { return app_body_states(control()->body); }
static app_body *force(void) { return control()->body; }

static void power_on_leads_through_selftest_to_idle_without_current(void)
{
  bench_start();
  CHECK(states()->state == ANHYST_STATE_INIT);
  for (int i = 0; i < 9; i++) {
    bench_ticks(1);
    CHECK(states()->state == ANHYST_STATE_SELFTEST && bench.drive == 0);
  }
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_IDLE && bench.drive == 0);
  CHECK((bench.drive_state & 0xFFU) == ANHYST_STATE_IDLE);
}

static void invalid_block_is_a_fault_that_clear_does_not_end(void)
{
  bench_start();
  bench_words[ANHYST_WORD_MAGIC] = 0;
  bench_restart();
  (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_FAULT && states()->fault == ANHYST_FAULT_BLOCK);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_BLOCK);
  bench_ticks(50);
  CHECK(bench.drive == 0 && fake.commits == 0);
}

static void current_follows_the_demand_only_in_run(void)
{
  bench_start();
  bench_ticks(12);
  (void)bench_demand(1000);
  bench_ticks(2);
  CHECK(bench.drive == 0);
  (void)bench_command(ANHYST_COMMAND_ARM);
  (void)bench_demand(1000);
  bench_ticks(2);
  CHECK(bench.drive == 0 && states()->state == ANHYST_STATE_READY);
  (void)bench_command(ANHYST_COMMAND_RUN);
  bench_ticks(1);
  CHECK(bench.drive == 0 && states()->state == ANHYST_STATE_RUN);
  (void)bench_demand(1000);
  bench_ticks(1);
  CHECK(bench.drive == 500);
  (void)bench_command(ANHYST_COMMAND_STOP);
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_READY && bench.drive == 0);
}

/* Brings the controller to the state IDLE, READY, RUN or FAULT. */
static void enter_state(uint16_t state)
{
  bench_start();
  bench_ticks(12);
  if (state == ANHYST_STATE_READY || state == ANHYST_STATE_RUN) {
    (void)bench_command(ANHYST_COMMAND_ARM);
  }
  if (state == ANHYST_STATE_RUN) {
    (void)bench_command(ANHYST_COMMAND_RUN);
  }
  if (state == ANHYST_STATE_FAULT) {
    bench.sample.tick += 100;
    bench_ticks(1);
  }
  CHECK(states()->state == state);
}

/* Sends each command in each state, and checks the next state; -1: the command is refused. */
static void commands_are_performed_only_in_their_states(void)
{
  static const int leads[ANHYST_COMMAND_COUNT][4] = {
      /* from IDLE, READY, RUN, FAULT; -2: this controller does not have the command */
      {ANHYST_STATE_IDLE, ANHYST_STATE_READY, ANHYST_STATE_RUN, ANHYST_STATE_FAULT}, /* none */
      {ANHYST_STATE_IDLE, ANHYST_STATE_IDLE, -1, -1},                                /* condition */
      {ANHYST_STATE_READY, ANHYST_STATE_READY, -1, -1},              /* demagnetised */
      {-2, -2, -2, -2},                                              /* lift */
      {-2, -2, -2, -2},                                              /* land */
      {-1, -1, ANHYST_STATE_READY, -1},                              /* stop */
      {-1, -1, -1, ANHYST_STATE_SELFTEST},                           /* clear */
      {ANHYST_STATE_IDLE, ANHYST_STATE_IDLE, ANHYST_STATE_IDLE, -1}, /* idle */
      {ANHYST_STATE_READY, -1, -1, -1},                              /* arm */
      {-1, ANHYST_STATE_RUN, -1, -1},                                /* run */
  };
  for (int command = 0; command < (int)ANHYST_COMMAND_COUNT; command++) {
    for (int from = 0; from < 4; from++) {
      const int wanted = leads[command][from];
      enter_state((uint16_t)(ANHYST_STATE_IDLE + (unsigned)from));
      (void)bench_command((uint16_t)command);
      const int refusal = wanted == -2 ? LINK_REASON_VALUE : LINK_REASON_STATE;
      CHECK(bench_reason() == (wanted < 0 ? refusal : LINK_REASON_NONE));
      CHECK(bench_detail() == (wanted < 0 ? (int)ANHYST_STATE_IDLE + from : wanted));
    }
  }
  CHECK(bench_command(ANHYST_COMMAND_COUNT) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_VALUE);
}

static void conditioning_drives_its_sequence_and_ends_in_ready(void)
{
  bench_start();
  bench_ticks(12);
  (void)bench_command(ANHYST_COMMAND_CONDITION);
  for (int i = 1; i <= FAKE_CYCLES * FAKE_CYCLE_TICKS; i++) {
    CHECK(states()->state == ANHYST_STATE_IDLE);
    CHECK((control()->flags & ANHYST_CONDITIONING) != 0);
    bench_ticks(1);
    CHECK(bench.drive == i * FAKE_CONDITION_STEP);
    CHECK(fake.committed == bench.drive);
  }
  bench_ticks(1); /* the tick after the last tick of the sequence */
  CHECK(states()->state == ANHYST_STATE_READY && (control()->flags & ANHYST_KNOWN) != 0);
  bench_ticks(25);
  CHECK(bench.drive == 0 && (control()->flags & ANHYST_CONDITIONING) == 0);
}

static void idle_ends_conditioning_with_an_unknown_state(void)
{
  bench_start();
  bench_ticks(12);
  (void)bench_command(ANHYST_COMMAND_CONDITION);
  bench_ticks(3);
  (void)bench_command(ANHYST_COMMAND_IDLE);
  bench_ticks(30);
  CHECK(states()->state == ANHYST_STATE_IDLE && bench.drive == 0);
  CHECK((control()->flags & ANHYST_KNOWN) == 0);
}

/* Runs at the board's largest current; the caller injects a fault, and checks reason and ramp. */
static void begin_at_full_current(void)
{
  bench_start();
  bench_run();
  (void)bench_demand(INT32_MAX);
  bench_ticks(1);
}

static void check_safe_ramp(uint16_t fault)
{
  CHECK(states()->state == ANHYST_STATE_FAULT);
  if (states()->fault != fault) {
    printf("reason %d instead of %d\n", (int)states()->fault, (int)fault);
  }
  CHECK(states()->fault == fault);
  CHECK(bench.drive_state == ANHYST_STATE_FAULT + 256U * fault);
  int32_t last = bench.drive;
  /* 20 ms at 1000 ticks a second; the tick of the fault was the first. */
  for (int i = 0; i < 19; i++) {
    bench_ticks(1);
    CHECK(bench.drive >= 0 && bench.drive <= last);
    last = bench.drive;
  }
  CHECK(bench.drive == 0);
  CHECK(states()->fault == fault);
  /* Only the command `clear` leaves the state FAULT, and it leads to the self-test. */
  bench_ticks(200);
  CHECK(states()->state == ANHYST_STATE_FAULT);
  CHECK(bench_command(ANHYST_COMMAND_ARM) == LINK_TYPE_NAK);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_ACK);
}

static void check_return_after_clear(void)
{
  bench_ticks(12);
  CHECK(states()->state == ANHYST_STATE_IDLE && states()->fault == ANHYST_FAULT_NONE);
  CHECK((control()->flags & ANHYST_KNOWN) == 0);
}

/* Runs ticks with this value of one sensor; the other sensors do not change. */
static void run_with_sensor_value(int32_t *sensor, int32_t value, int count)
{
  const int32_t before = *sensor;
  for (int i = 0; i < count; i++) {
    *sensor = value;
    bench_tick();
  }
  *sensor = before;
}

static void each_sensor_fault_has_its_reason(void)
{
  int32_t *sensors[3] = {&bench.sample.gap, &bench.sample.force, &bench.sample.current[0]};
  for (int i = 0; i < 3; i++) {
    const int32_t beyond[2] = {INT32_MAX, -INT32_MAX};
    begin_at_full_current();
    run_with_sensor_value(sensors[i], PORT_RESERVED, 3);
    check_safe_ramp((uint16_t)(ANHYST_FAULT_GAP_RESERVED + 4U * (unsigned)i));
    check_return_after_clear();
    for (int side = 0; side < 2; side++) {
      begin_at_full_current();
      run_with_sensor_value(sensors[i], beyond[side], 3);
      check_safe_ramp((uint16_t)(ANHYST_FAULT_GAP_RANGE + 4U * (unsigned)i));
      check_return_after_clear();
    }
    begin_at_full_current();
    run_with_sensor_value(sensors[i], *sensors[i] + PORT_ONE / 100 * 62, 3);
    check_safe_ramp((uint16_t)(ANHYST_FAULT_GAP_SLEW + 4U * (unsigned)i));
    check_return_after_clear();
  }
}

static void missing_samples_are_a_fault(void)
{
  begin_at_full_current();
  bench.sample.status = PORT_NO_SAMPLE;
  bench_ticks(3);
  bench.sample.status = 0;
  check_safe_ramp(ANHYST_FAULT_SENSOR_FAILED);
}

static void hardware_report_is_an_immediate_fault(void)
{
  static const uint16_t reports[5][2] = {
      {PORT_AMPLIFIER, ANHYST_FAULT_AMPLIFIER},
      {PORT_EMERGENCY_STOP, ANHYST_FAULT_EMERGENCY_STOP},
      {PORT_OVER_CURRENT, ANHYST_FAULT_OVER_CURRENT},
      {PORT_SUPPLY, ANHYST_FAULT_SUPPLY},
      {PORT_TOO_WARM, ANHYST_FAULT_TOO_WARM},
  };
  for (int i = 0; i < 5; i++) {
    begin_at_full_current();
    bench.sample.status = reports[i][0];
    bench_ticks(1);
    check_safe_ramp(reports[i][1]);
    bench_ticks(100);
    CHECK(states()->state == ANHYST_STATE_FAULT); /* the port still reports the fault */
    bench.sample.status = 0;
    CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_ACK);
    check_return_after_clear();
  }
}

static void change_without_samples_is_divided_by_its_time(void)
{
  bench_start();
  bench_run();
  bench.sample.status = PORT_NO_SAMPLE;
  bench_ticks(2);
  bench.sample.status = 0;
  bench.sample.gap += PORT_ONE / 100 * 2; /* in three ticks; PORT_ONE/100 is allowed in one tick */
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_RUN && states()->sample_age == 0);
}

static void last_plausible_sample_replaces_two_implausible_ones(void)
{
  bench_start();
  bench_run();
  (void)bench_demand(1000);
  bench_ticks(1);
  const int32_t gap = force()->gap.value;
  run_with_sensor_value(&bench.sample.gap, PORT_RESERVED, 2);
  CHECK(states()->state == ANHYST_STATE_RUN && bench.drive == 500);
  CHECK((control()->flags & ANHYST_SAMPLE_IMPLAUSIBLE) != 0);
  CHECK(fake.solved_gap == 2 * gap);
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_RUN);
  CHECK((control()->flags & ANHYST_SAMPLE_IMPLAUSIBLE) == 0);
}

static void a_fast_but_possible_change_is_no_fault(void)
{
  bench_start();
  bench_run();
  for (int i = 0; i < 40; i++) {
    bench.sample.gap += PORT_ONE / 101;
    bench_ticks(1);
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

static void sensor_without_noise_is_stuck_if_the_current_moves(void)
{
  int32_t *sensors[3] = {&bench.sample.gap, &bench.sample.force, &bench.sample.current[0]};
  const int windows[3] = {20, 30, 40};
  for (int i = 0; i < 3; i++) {
    bench_start();
    bench_run();
    bench_ticks(1);
    const int32_t frozen = *sensors[i];
    for (int tick = 1; tick <= windows[i]; tick++) {
      CHECK(states()->state == ANHYST_STATE_RUN);
      (void)bench_demand(INT32_MAX / 4 * (tick % 3));
      bench.sample.gap ^= 64;
      bench.sample.force ^= 64;
      bench.sample.current[0] ^= 64;
      run_with_sensor_value(sensors[i], frozen, 1);
    }
    check_safe_ramp((uint16_t)(ANHYST_FAULT_GAP_STUCK + 4U * (unsigned)i));
  }
}

static void constant_gap_with_noise_is_not_stuck(void)
{
  bench_start();
  bench_run();
  for (int tick = 0; tick < 500; tick++) {
    (void)bench_demand(INT32_MAX / 4 * (tick % 3));
    bench_ticks(1);
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

static void frozen_code_is_no_fault_at_constant_current(void)
{
  bench_start();
  bench_run();
  for (int tick = 0; tick < 500; tick++) {
    (void)bench_demand(1000);
    bench_tick();
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

static void lost_link_ends_run_but_not_idle(void)
{
  begin_at_full_current();
  (void)bench_demand(INT32_MAX);
  bench_ticks(100);
  CHECK(states()->state == ANHYST_STATE_RUN); /* a silence of 100 ms is allowed */
  bench_ticks(1);
  check_safe_ramp(ANHYST_FAULT_LINK_LOST);
  check_return_after_clear();
  bench_ticks(1000);
  CHECK(states()->state == ANHYST_STATE_IDLE);
}

static void a_lost_link_ends_conditioning(void)
{
  bench_start();
  bench_words[ANHYST_WORD_CONDITION_TICKS] = 1000;
  bench_ticks(12);
  (void)bench_command(ANHYST_COMMAND_CONDITION);
  bench_ticks(101);
  CHECK(states()->state == ANHYST_STATE_FAULT && states()->fault == ANHYST_FAULT_LINK_LOST);
  bench_ticks(20);
  CHECK(bench.drive == 0);
}

static void repeated_frame_is_no_heartbeat(void)
{
  begin_at_full_current();
  (void)bench_request(LINK_TYPE_HEARTBEAT, NULL, 0);
  const uint8_t number = bench.answer.sequence;
  for (int tick = 0; tick < 101; tick++) {
    CHECK(states()->state == ANHYST_STATE_RUN);
    bench_ticks(1);
    (void)bench_put_frame(LINK_TYPE_HEARTBEAT, number, NULL, 0);
    bench_poll();
    (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
  }
  check_safe_ramp(ANHYST_FAULT_LINK_LOST);
}

static void any_new_request_is_a_heartbeat(void)
{
  bench_start();
  bench_run();
  for (int i = 0; i < 20; i++) {
    bench_ticks(90);
    CHECK(bench_state() == ANHYST_STATE_RUN);
  }
}

static void three_missed_ticks_are_counted_and_four_are_a_fault(void)
{
  begin_at_full_current();
  const int32_t held = bench.drive;
  bench.sample.tick += 3;
  bench_ticks(1);
  CHECK(states()->state == ANHYST_STATE_RUN && control()->missed_ticks == 3 && bench.drive == held);
  bench.sample.tick += 4;
  bench_ticks(1);
  check_safe_ramp(ANHYST_FAULT_MISSED_TICK);
}

static void repeated_or_decreasing_tick_is_a_fault(void)
{
  begin_at_full_current();
  bench.sample.tick -= 1;
  bench_ticks(1);
  check_safe_ramp(ANHYST_FAULT_MISSED_TICK);
  begin_at_full_current();
  bench.sample.tick -= 10;
  bench_ticks(1);
  check_safe_ramp(ANHYST_FAULT_MISSED_TICK);
}

static void tick_number_may_start_anywhere_and_wrap(void)
{
  bench_start();
  bench.sample.tick = UINT32_MAX - 20;
  bench_run();
  bench_ticks(60);
  CHECK(states()->state == ANHYST_STATE_RUN && control()->missed_ticks == 0);
}

static void first_fault_reason_is_kept(void)
{
  begin_at_full_current();
  bench.sample.tick += 50;
  bench_ticks(1);
  run_with_sensor_value(&bench.sample.gap, PORT_RESERVED, 10);
  CHECK(states()->fault == ANHYST_FAULT_MISSED_TICK);
}

/* Three commands in three ticks at full current: the current falls along the ramp, and a return to
   RUN waits until the ramp has ended. */
static void no_sequence_of_commands_is_faster_than_the_ramp(void)
{
  for (int first = 0; first < (int)ANHYST_COMMAND_COUNT; first++) {
    for (int second = 0; second < (int)ANHYST_COMMAND_COUNT; second++) {
      for (int third = 0; third < (int)ANHYST_COMMAND_COUNT; third++) {
        const int commands[3] = {first, second, third};
        begin_at_full_current();
        for (int i = 0; i < 40; i++) {
          const int32_t before = bench.drive;
          if (i < 3) {
            (void)bench_command((uint16_t)commands[i]);
          }
          bench_ticks(1);
          CHECK(bench.drive <= before && bench.drive >= before - force()->ramp_step);
        }
      }
    }
  }
}

static void run_waits_for_zero_current(void)
{
  begin_at_full_current();
  (void)bench_command(ANHYST_COMMAND_STOP);
  bench_ticks(1);
  CHECK(bench_command(ANHYST_COMMAND_RUN) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_CURRENT && bench_detail() == ANHYST_STATE_READY);
  bench_ticks(20);
  CHECK(bench_command(ANHYST_COMMAND_RUN) == LINK_TYPE_ACK);
}

static void clear_waits_for_zero_current(void)
{
  begin_at_full_current();
  bench.sample.tick += 50;
  bench_ticks(1);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_CURRENT);
  bench_ticks(20);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_ACK);
}

static void board_limits_the_current_of_the_block(void)
{
  begin_at_full_current();
  CHECK(bench.drive == INT32_MAX / 2);
  bench_limits.current_high = 7000;
  bench_ticks(1);
  CHECK(bench.drive == 7000 && (control()->flags & ANHYST_CURRENT_LIMITED) != 0);
  CHECK(fake.committed == 7000);
  bench_limits.current_low = -6000;
  (void)bench_demand(INT32_MIN);
  bench_ticks(2); /* the largest slew is full scale per tick, and this change is twice full scale */
  CHECK(bench.drive == -6000);
}

static void demand_changes_at_most_by_its_slew(void)
{
  bench_start();
  bench_run();
  (void)bench_set(LINK_SETTING_DEMAND_SLEW, 100);
  (void)bench_demand(250);
  const int32_t expected[4] = {50, 100, 125, 125};
  for (int i = 0; i < 4; i++) {
    bench_ticks(1);
    CHECK(bench.drive == expected[i]);
    CHECK(((control()->flags & ANHYST_DEMAND_SLEWING) != 0) == (i < 2));
  }
  (void)bench_demand(INT32_MIN);
  bench_ticks(1);
  CHECK(force()->demand == 150);
}

static void without_compensation_the_ratio_is_constant(void)
{
  bench_start();
  CHECK(bench_set(LINK_SETTING_COMPENSATION, 0) == LINK_TYPE_SETTING);
  CHECK(bench_set(LINK_SETTING_RATIO, PORT_ONE / 4 * 3) == LINK_TYPE_SETTING);
  bench_run();
  const int solves = fake.solves;
  (void)bench_demand(PORT_ONE);
  bench_ticks(1);
  const int64_t off = (int64_t)bench.drive - (int64_t)PORT_ONE / 4 * 3;
  CHECK(off <= 0 && off > -(PORT_ONE >> 15));
  CHECK(fake.solves == solves && fake.committed == bench.drive);
}

static void memory_follows_driven_or_measured_current(void)
{
  bench_start();
  bench_run();
  (void)bench_demand(1000);
  bench_ticks(1);
  CHECK(fake.committed == 500 && fake.committed_gap == fake.solved_gap);
  (void)bench_command(ANHYST_COMMAND_STOP);
  CHECK(bench_set(LINK_SETTING_FOLLOW, 1) == LINK_TYPE_SETTING);
  (void)bench_command(ANHYST_COMMAND_RUN);
  bench.sample.current[0] = 123456;
  const int commits = fake.commits;
  bench_tick();
  CHECK(fake.committed == 2 * 123456 && fake.commits == commits + 1);
}

static void memory_is_updated_in_every_state_and_set_by_command(void)
{
  bench_start();
  bench_ticks(12);
  CHECK(fake.commits == 12);
  force()->compensator.memory.number[0] = 99;
  CHECK(bench_command(ANHYST_COMMAND_DEMAGNETISED) == LINK_TYPE_ACK);
  CHECK(force()->compensator.memory.number[0] == 0);
}

static void the_gap_reaches_the_compensator_within_its_range(void)
{
  bench_start();
  bench_run();
  bench_ticks(1);
  CHECK(fake.solved_gap == 2 * bench.sample.gap);
  bench_limits.gap.slew = INT32_MAX;
  bench.sample.gap = PORT_ONE / 100 * 105;
  bench_tick();
  CHECK(fake.solved_gap == INT32_MAX && states()->state == ANHYST_STATE_RUN);
  bench.sample.gap = -PORT_ONE / 20;
  bench_tick();
  CHECK(fake.solved_gap == 0 && states()->state == ANHYST_STATE_RUN);
}

int main(void)
{
  power_on_leads_through_selftest_to_idle_without_current();
  invalid_block_is_a_fault_that_clear_does_not_end();
  current_follows_the_demand_only_in_run();
  commands_are_performed_only_in_their_states();
  conditioning_drives_its_sequence_and_ends_in_ready();
  idle_ends_conditioning_with_an_unknown_state();
  each_sensor_fault_has_its_reason();
  missing_samples_are_a_fault();
  hardware_report_is_an_immediate_fault();
  change_without_samples_is_divided_by_its_time();
  last_plausible_sample_replaces_two_implausible_ones();
  a_fast_but_possible_change_is_no_fault();
  sensor_without_noise_is_stuck_if_the_current_moves();
  constant_gap_with_noise_is_not_stuck();
  frozen_code_is_no_fault_at_constant_current();
  lost_link_ends_run_but_not_idle();
  a_lost_link_ends_conditioning();
  repeated_frame_is_no_heartbeat();
  any_new_request_is_a_heartbeat();
  three_missed_ticks_are_counted_and_four_are_a_fault();
  repeated_or_decreasing_tick_is_a_fault();
  tick_number_may_start_anywhere_and_wrap();
  first_fault_reason_is_kept();
  no_sequence_of_commands_is_faster_than_the_ramp();
  run_waits_for_zero_current();
  clear_waits_for_zero_current();
  board_limits_the_current_of_the_block();
  demand_changes_at_most_by_its_slew();
  without_compensation_the_ratio_is_constant();
  memory_follows_driven_or_measured_current();
  memory_is_updated_in_every_state_and_set_by_command();
  the_gap_reaches_the_compensator_within_its_range();
  return verdict();
}
