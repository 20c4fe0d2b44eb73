/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the comparison of measured and driven current: which faults it finds and how soon.
   Ten minutes of normal operation raise no fault. */
#include "../core/check.h"
#include "bench.h"

/* Default settings at BENCH_RATE, ticks. */
enum { LAG = 5, SWEEP = 50, OFF = 20 };
enum { TEN_MINUTES = 600 * BENCH_RATE };
#define TOLERANCE 0.05
#define TEST_CURRENT 0.72    /* current of the fault cases, fraction of full scale */
#define CONVERTER_CODES 2048 /* converter steps in full scale */

/* An amplifier and its current sensor; fractions of full scale. */
typedef struct {
  double share;  /* fraction of the missing current that the amplifier adds in a tick */
  double slew;   /* largest change in a tick: voltage limit divided by inductance */
  double gain;   /* gain of the sensor */
  double offset; /* offset of the sensor */
  double noise;  /* largest noise of the sensor */
  double current;
} amplifier;

static const amplifier normal = {0.5, 0.03, 1.02, 0.01, 0.004, 0.0};
static const amplifier slowest = {1.0 / (double)LAG, 1.0 / (double)SWEEP, 1.0, 0.0, 0.004, 0.0};

static uint32_t seed;

/* Returns a random number between -1 and 1. */
static double random_number(void)
{
  seed = 1664525U * seed + 1013904223U;
  return (double)(seed >> 8) / 8388608.0 - 1.0;
}

static const anhyst_supervisor *states(void)
{
  return app_body_states(bench.firmware.control.body);
}

static double driven(void) { return bench.drive / 2147483648.0; }

static int32_t code_of(double part)
{
  return (int32_t)floor(part * CONVERTER_CODES + 0.5) * (PORT_ONE / CONVERTER_CODES);
}

/* Runs one tick: the amplifier follows the driven current, and the sensor measures it. */
static void tick_with_amplifier(amplifier *a)
{
  const double step = a->share * (driven() - a->current);
  a->current += step > a->slew ? a->slew : step < -a->slew ? -a->slew : step;
  bench.sample.current[0] = code_of(a->gain * a->current + a->offset + a->noise * random_number());
  bench.sample.gap ^= 64;
  bench.sample.force ^= 64;
  bench_tick();
}

/* Starts a controller on a board that measures its current, with the full current allowed. */
static void start(void)
{
  bench_start();
  bench_limits.has_current_sensor = 1;
  bench_limits.current.low = -PORT_ONE / 4 * 5;
  bench_limits.current.high = PORT_ONE / 4 * 5;
  bench_limits.current.slew = INT32_MAX;
  bench_limits.current.stuck_ticks = 0; /* otherwise the stuck rule finds the faults */
  bench_limits.current_low = INT32_MIN;
  bench_limits.current_high = INT32_MAX;
  bench_restart();
  (void)bench_hello(255, LINK_VERSION, BENCH_SESSION);
}

/* Demands a current. The compensator of the bench halves a demand. */
static void demand(double current)
{
  bench_words[FAKE_EXTRA_CURRENT] = (int16_t)(current > 0.0 ? 16384 : -16384);
  (void)bench_demand((int32_t)((2.0 * current - (current > 0.0 ? 1.0 : -1.0)) * 2147483000.0));
}

/* Runs the demanded current for some ticks while the link is alive. */
static void hold(amplifier *a, double current, int ticks)
{
  for (int i = 0; i < ticks; i++) {
    if (i % 50 == 0) {
      demand(current);
    }
    tick_with_amplifier(a);
  }
}

static void run(amplifier *a)
{
  for (int i = 0; i < 12; i++) {
    tick_with_amplifier(a);
  }
  CHECK(bench_command(ANHYST_COMMAND_ARM) == LINK_TYPE_ACK);
  CHECK(bench_command(ANHYST_COMMAND_RUN) == LINK_TYPE_ACK);
  hold(a, 0.02, 20);
  CHECK(states()->state == ANHYST_STATE_RUN);
}

/* Returns the ticks until the fault current_mismatch, or -1. */
static int ticks_until_fault(amplifier *a, double current, int most)
{
  for (int i = 1; i <= most; i++) {
    hold(a, current, 1);
    if (states()->state == ANHYST_STATE_FAULT) {
      CHECK(states()->fault == ANHYST_FAULT_CURRENT_MISMATCH);
      CHECK(bench.drive_state == ANHYST_STATE_FAULT + 256U * ANHYST_FAULT_CURRENT_MISMATCH);
      return i;
    }
  }
  return -1;
}

/* Fault of the sensor or the amplifier from one tick on. */
typedef struct {
  const char *name;
  amplifier after;
} breakage;

static const breakage breakages[] = {
    {"disconnected sensor", {0.5, 0.03, 0.0, 0.0, 0.0, 0.0}},
    {"disconnected sensor with noise", {0.5, 0.03, 0.0, 0.0, 0.004, 0.0}},
    {"gain 20 % too high", {0.5, 0.03, 1.2, 0.0, 0.004, 0.0}},
    {"gain 20 % too low", {0.5, 0.03, 0.8, 0.0, 0.004, 0.0}},
    {"wrong sign", {0.5, 0.03, -1.0, 0.0, 0.004, 0.0}},
    {"amplifier without output", {0.0, 0.03, 1.0, 0.0, 0.004, 0.0}},
    {"amplifier at a tenth of its voltage", {0.5, 0.003, 1.0, 0.0, 0.004, 0.0}},
};
enum { BREAKAGES = sizeof breakages / sizeof breakages[0] };

/* After a step of the demand, the slowest allowed response takes SWEEP + 3 * LAG ticks. */
static void initial_fault_is_found_once_current_flows(void)
{
  for (int i = 0; i < BREAKAGES; i++) {
    amplifier a = breakages[i].after;
    start();
    run(&a);
    CHECK_BELOW(breakages[i].name, ticks_until_fault(&a, TEST_CURRENT, 5000),
                SWEEP + 3 * LAG + OFF + 1);
    CHECK(states()->fault == ANHYST_FAULT_CURRENT_MISMATCH);
    hold(&a, 0.0, 25);
    CHECK(bench.drive == 0);
  }
}

/* At a constant current, only the number of samples matters. */
static void fault_at_constant_current_is_found_after_off_ticks(void)
{
  for (int i = 0; i < 5; i++) {
    amplifier a = normal;
    start();
    run(&a);
    hold(&a, TEST_CURRENT, 200);
    CHECK(states()->state == ANHYST_STATE_RUN);
    a.gain = breakages[i].after.gain;
    a.noise = breakages[i].after.noise;
    a.offset = 0.0;
    CHECK(ticks_until_fault(&a, TEST_CURRENT, 5000) == OFF + 1);
  }
}

static void frozen_sensor_is_found_if_the_current_moves(void)
{
  amplifier a = normal;
  start();
  run(&a);
  hold(&a, TEST_CURRENT, 200);
  const amplifier stuck = {0.5, 0.03, 0.0, TEST_CURRENT, 0.0, TEST_CURRENT};
  a = stuck;
  hold(&a, TEST_CURRENT, 1000);
  CHECK(states()->state == ANHYST_STATE_RUN);
  const int found = ticks_until_fault(&a, 0.3, 5000);
  CHECK(found > OFF);
  CHECK_BELOW("ticks until a stuck sensor is found", found, SWEEP + 3 * LAG + OFF + 1);
}

/* The number of bad samples that the setting allows causes no fault. */
static void a_short_deviation_is_no_fault(void)
{
  amplifier a = normal;
  start();
  run(&a);
  hold(&a, TEST_CURRENT, 200);
  for (int i = 0; i < 100; i++) {
    a.gain = 0.0;
    hold(&a, TEST_CURRENT, OFF);
    a.gain = normal.gain;
    hold(&a, TEST_CURRENT, 1);
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

/* Error codes of a sensor now and then do not prevent that a wrong value is found. */
static void sample_without_a_value_does_not_reset_the_count(void)
{
  amplifier a = normal;
  int ticks = 0;
  start();
  run(&a);
  hold(&a, TEST_CURRENT, 200);
  a.gain = 0.8;
  for (; states()->state == ANHYST_STATE_RUN && ticks < 1000; ticks++) {
    if (ticks % 2 == 0) {
      hold(&a, TEST_CURRENT, 1);
    } else {
      bench.sample.current[0] = PORT_RESERVED;
      bench_tick();
    }
  }
  CHECK(states()->fault == ANHYST_FAULT_CURRENT_MISMATCH);
  CHECK_BELOW("ticks with every second sample", ticks, 2 * OFF + 3);
}

static void slowest_allowed_amplifier_is_no_fault(void)
{
  amplifier a = slowest;
  start();
  run(&a);
  for (int i = 0; i < 200; i++) {
    hold(&a, 0.95 * random_number(), 10 + i % 90);
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

static void without_a_current_sensor_nothing_is_compared(void)
{
  amplifier a = breakages[0].after;
  start();
  bench_limits.has_current_sensor = 0;
  run(&a);
  hold(&a, TEST_CURRENT, 5000);
  CHECK(states()->state == ANHYST_STATE_RUN);
}

/* After clear, the check starts again from the current that flows at that time. */
static void clear_restarts_the_check(void)
{
  amplifier a = normal;
  start();
  run(&a);
  hold(&a, TEST_CURRENT, 200);
  a.gain = 0.0;
  CHECK(ticks_until_fault(&a, TEST_CURRENT, 100) > 0);
  a = normal;
  a.current = 0.2; /* the winding still carries current */
  a.slew = 0.02;
  hold(&a, 0.0, 25);
  CHECK(bench_command(ANHYST_COMMAND_CLEAR) == LINK_TYPE_ACK);
  a.current = 0.2;
  for (int i = 0; i < 100; i++) {
    tick_with_amplifier(&a);
  }
  CHECK(states()->state == ANHYST_STATE_IDLE);
}

static void settings_cannot_change_while_running(void)
{
  amplifier a = normal;
  start();
  CHECK(bench_set(LINK_SETTING_CURRENT_OFF_TICKS, 500) == LINK_TYPE_SETTING);
  CHECK(bench_set(LINK_SETTING_CURRENT_OFF_TICKS, 501) == LINK_TYPE_NAK);
  CHECK(bench_set(LINK_SETTING_CURRENT_TOLERANCE, INT32_MAX / 4 + 1) == LINK_TYPE_NAK);
  CHECK(bench_set(LINK_SETTING_CURRENT_LAG_TICKS, 0) == LINK_TYPE_NAK);
  CHECK(bench_set(LINK_SETTING_CURRENT_SWEEP_TICKS, 0) == LINK_TYPE_NAK);
  CHECK(bench_set(LINK_SETTING_CURRENT_OFF_TICKS, 3) == LINK_TYPE_SETTING);
  run(&a);
  CHECK(bench_set(LINK_SETTING_CURRENT_TOLERANCE, INT32_MAX / 8) == LINK_TYPE_NAK);
  CHECK(bench_reason() == LINK_REASON_STATE);
  hold(&a, TEST_CURRENT, 200);
  a.gain = 0.0;
  CHECK(ticks_until_fault(&a, TEST_CURRENT, 100) == 4);
}

/* Steps, sines, constant values and stops of the demand, start-up sequences, and arming again. */
static void ten_minutes_of_normal_operation_raise_no_fault(void)
{
  amplifier a = normal;
  double from = 0.0;
  double to = 0.0;
  start();
  run(&a);
  for (int i = 0; i < TEN_MINUTES && states()->state == ANHYST_STATE_RUN; i++) {
    const int phase = i % 1000;
    if (phase == 0) {
      from = to;
      to = 0.95 * random_number();
    }
    if (i % 20 == 0) {
      const double wave = 0.3 * sin(0.003 * phase * (i / 1000 % 100));
      const double rest = 0.5 * (from + to);
      demand(i / 1000 % 3 == 0 ? to : i / 1000 % 3 == 1 ? 0.6 * rest + wave : rest);
    }
    tick_with_amplifier(&a);
    if (i % 10000 == 9999) { /* stopped at any current, and started again */
      CHECK(bench_command(ANHYST_COMMAND_STOP) == LINK_TYPE_ACK);
      for (int k = 0; k < 40; k++) {
        tick_with_amplifier(&a);
      }
      CHECK(bench_command(ANHYST_COMMAND_RUN) == LINK_TYPE_ACK);
    }
  }
  CHECK(states()->state == ANHYST_STATE_RUN);
}

int main(void)
{
  seed = 48;
  initial_fault_is_found_once_current_flows();
  fault_at_constant_current_is_found_after_off_ticks();
  frozen_sensor_is_found_if_the_current_moves();
  a_short_deviation_is_no_fault();
  sample_without_a_value_does_not_reset_the_count();
  slowest_allowed_amplifier_is_no_fault();
  without_a_current_sensor_nothing_is_compared();
  clear_restarts_the_check();
  settings_cannot_change_while_running();
  ten_minutes_of_normal_operation_raise_no_fault();
  return verdict();
}
