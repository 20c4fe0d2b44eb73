/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of the controller of an axis in fixed point, and of its parts: filter, allocation. */
#include "anhyst/control/tracking.h"

#include "anhyst/control/allocation_real.h"
#include "anhyst/control/biquad.h"
#include "anhyst/control/tracking_real.h"
#include "check.h"
#include "edges.h"
#include "maps.h"

#define ONE 2147483648.0

static int16_t entries[MOST_COLUMNS * MOST_ROWS];

static anhyst_factor to_factor(double value)
{
  int exponent;
  const double fraction = frexp(value, &exponent);
  const anhyst_factor factor = {(int16_t)lround(fraction * 32767.0), (int16_t)(exponent + 1)};
  return factor;
}

/* ---- allocation ---- */

/* The error of either force, in units in the last place; 0 where the larger one saturates. */
static double error_of_class_ab(int32_t net, int32_t idle)
{
  const anhyst_allocation_q31 fixed = {idle, ANHYST_ALLOCATE_CLASS_AB};
  const anhyst_allocation_f64 real = {idle, ANHYST_ALLOCATE_CLASS_AB};
  int32_t found[2];
  double exact[2];
  anhyst_allocate_q31(&fixed, net, found);
  anhyst_allocate_f64(&real, net, exact);
  CHECK(found[0] >= 0 && found[1] >= 0);
  const int along = net >= 0 ? 0 : 1;
  if (exact[along] >= ONE - 1.0) {
    CHECK(found[along] > ANHYST_Q31_MAX - ANHYST_ALLOCATION_ERROR);
    return 0.0;
  }
  return fmax(fabs(found[0] - exact[0]), fabs(found[1] - exact[1]));
}

static void class_ab_is_shared_out_as_in_exact_arithmetic(void)
{
  double worst = 0.0;
  for (int i = 0; i < EDGE_COUNT; i++) {
    for (int j = 0; j < EDGE_COUNT; j++) {
      if (edge(j) > 0) {
        keep_worst(&worst, error_of_class_ab(edge(i), edge(j)));
      }
    }
  }
  for (int i = 0; i < 400000; i++) {
    const int32_t net = any_code() >> any_within(0, 30);
    const int32_t idle = (any_code() & 0x7FFFFFFF) >> any_within(0, 30);
    keep_worst(&worst, error_of_class_ab(net, idle > 0 ? idle : 1));
  }
  CHECK_BELOW("units in the last place of a force", worst, ANHYST_ALLOCATION_ERROR);
}

static void a_pair_of_class_a_and_a_single_drive_get_the_net_force(void)
{
  for (int i = 0; i < 10000; i++) {
    const int32_t net = any_code() / 2;
    const int32_t idle = any_within(1, ANHYST_Q30_ONE);
    const anhyst_allocation_q31 halves = {idle, ANHYST_ALLOCATE_BY_HALVES};
    const anhyst_allocation_q31 single = {0, ANHYST_ALLOCATE_SINGLE};
    int32_t force[2];
    anhyst_allocate_q31(&halves, net, force);
    CHECK(force[0] - force[1] == 2 * (net >> 1) && force[0] + (force[1] - idle) == idle);
    anhyst_allocate_q31(&single, net, force);
    CHECK(force[0] == net);
  }
}

/* ---- filter ---- */

/* In exact arithmetic with the same factors and from the same state; in units of q30. */
static double step_exactly(const anhyst_biquad_q31 *filter, const anhyst_biquad_state_q31 *state,
                           int32_t in, double *second)
{
  const double x = floor(in / 2.0);
  const double values[6] = {
      ldexp(filter->loss.mantissa, filter->loss.shift - 16),
      ldexp(filter->pass.mantissa, filter->pass.shift - 16),
      ldexp(filter->low.mantissa, filter->low.shift - 16),
      ldexp(filter->through.mantissa, filter->through.shift - 16),
      ldexp(filter->of_fast.mantissa, filter->of_fast.shift - 16),
      ldexp(filter->of_slow.mantissa, filter->of_slow.shift - 16),
  };
  const double missing = x - state->integral[1];
  const double fast = state->integral[0] - values[0] * state->integral[0] + values[1] * missing;
  const double slow = state->integral[1] + values[1] * state->integral[0] + values[2] * missing;
  *second = 2.0 * slow - state->integral[1];
  return values[3] * x + values[4] * fast + values[5] * slow;
}

/* A notch at g, wide as k says. */
static anhyst_biquad_q31 notch_at(double g, double k)
{
  const double d = 1.0 / (1.0 + g * (g + k));
  const anhyst_factor nothing = {0, 0};
  const anhyst_factor whole = {16384, 2};
  const anhyst_biquad_q31 filter = {to_factor(g * (g + k) * d),
                                    to_factor(g * d),
                                    to_factor(g * g * d),
                                    whole,
                                    to_factor(-k),
                                    nothing};
  return filter;
}

/* At 1/800 to 1/7 of the ticks. */
static double any_g(void)
{
  return ldexp(1.0, -any_within(0, 6)) * (1.0 + any_within(0, 1000) / 1000.0) / 4.0;
}

static double any_k(void) { return any_within(100, 2000) / 1000.0; }

static anhyst_biquad_q31 any_notch(void) { return notch_at(any_g(), any_k()); }

static void a_step_of_a_filter_is_that_of_exact_arithmetic(void)
{
  double worst = 0.0;
  double of_state = 0.0;
  for (int i = 0; i < 200000; i++) {
    const anhyst_biquad_q31 filter = any_notch();
    anhyst_biquad_state_q31 state = {{any_code() / 8, any_code() / 8}};
    const int32_t in = any_code() / 4;
    double second;
    const double exact = step_exactly(&filter, &state, in, &second);
    const int32_t out = anhyst_biquad_step_q31(&filter, &state, in);
    keep_worst(&worst, fabs(out / 2.0 - exact));
    keep_worst(&of_state, fabs(state.integral[1] - second));
  }
  CHECK_BELOW("units of q30, output", worst, 4.0 + 2.0 * 2.0);
  CHECK_BELOW("units of q30, integral", of_state, 2.0 * 2.0);
}

/* Whatever factors were rounded to: what stands still passes, to what rounding adds in the filter.
 */
static void a_notch_passes_what_stands_still(void)
{
  double worst = 0.0;
  for (int i = 0; i < 200; i++) {
    const double g = any_g();
    const double k = any_k();
    const anhyst_biquad_q31 filter = notch_at(g, k);
    anhyst_biquad_state_q31 state = {{0, 0}};
    const int32_t in = any_code() / 2;
    int32_t out = 0;
    for (int tick = 0; tick < 40000; tick++) {
      out = anhyst_biquad_step_q31(&filter, &state, in);
    }
    keep_worst(&worst, fabs((double)out - in) / (4.0 + k / g));
  }
  CHECK_BELOW("of 4 + k/g units in the last place", worst, 8.0);
}

/* Under sanitizers: no factor, state or signal makes anything overflow. */
static void any_filter_runs(void)
{
  for (int i = 0; i < 2000; i++) {
    const anhyst_biquad_q31 filter = {any_factor(), any_factor(), any_factor(),
                                      any_factor(), any_factor(), any_factor()};
    anhyst_biquad_state_q31 state = {{edge(any_within(0, EDGE_COUNT - 1)), any_code()}};
    CHECK(anhyst_biquad_check_q31(&filter) == ANHYST_OK);
    for (int tick = 0; tick < 100; tick++) {
      (void)anhyst_biquad_step_q31(&filter, &state, edge(any_within(0, EDGE_COUNT - 1)));
    }
  }
  anhyst_biquad_q31 wrong = any_notch();
  wrong.low.shift = 17;
  CHECK(anhyst_biquad_check_q31(&wrong) == ANHYST_BAD_PARAMETER);
}

/* ---- the whole ---- */

static anhyst_tracking_settings_q31 any_settings(const anhyst_biquad_q31 *filter)
{
  anhyst_tracking_settings_q31 settings = {0};
  settings.pid.proportional = any_factor();
  settings.pid.integral = any_factor();
  settings.pid.derivative = any_factor();
  settings.pid.load = any_factor();
  settings.pid.back.mantissa = (int16_t)any_within(0, 32767);
  settings.pid.smoothing.mantissa = (int16_t)any_within(-32768, 0);
  settings.pid.smoothing_2 = settings.pid.smoothing;
  settings.pid.low = any_within(ANHYST_Q31_MIN, 0);
  settings.pid.high = any_within(0, ANHYST_Q31_MAX);
  settings.allocation.kind = (uint16_t)any_within(1, 3);
  settings.allocation.idle = any_within(1, ANHYST_Q31_MAX);
  settings.current_step = any_within(0, 1 << any_within(0, 30));
  settings.current_low = any_within(ANHYST_Q31_MIN, ANHYST_Q31_MAX / 4);
  settings.current_high = any_within(settings.current_low, ANHYST_Q31_MAX);
  if (settings.current_step > 0) {
    const uint32_t range = (uint32_t)settings.current_high - (uint32_t)settings.current_low;
    const uint32_t steps = range / (uint32_t)settings.current_step;
    settings.current_high =
        (int32_t)((uint32_t)settings.current_low + steps * (uint32_t)settings.current_step);
  }
  settings.filter = filter;
  settings.filters = (uint16_t)any_within(0, 1);
  return settings;
}

static int is_drivable(const anhyst_tracking_settings_q31 *settings, int32_t current)
{
  const uint32_t above = (uint32_t)current - (uint32_t)settings->current_low;
  return current >= settings->current_low && current <= settings->current_high &&
         (settings->current_step == 0 || above % (uint32_t)settings->current_step == 0U);
}

/* Four drives in two pairs. Under sanitizers: nothing overflows, no current leaves its limits or
   the converter's grid, and both drives of a side get the same force. */
static void any_signal_is_answered_within_the_limits(void)
{
  for (int i = 0; i < 2000; i++) {
    const anhyst_map_q31 map = any_map(entries, (uint16_t)(i % 5), 0, 8000);
    const anhyst_biquad_q31 filter = any_notch();
    const anhyst_tracking_settings_q31 settings = any_settings(&filter);
    anhyst_force_controller_q31 magnet[4];
    anhyst_force_controller_q31 *drive[4];
    anhyst_biquad_state_q31 filtered;
    anhyst_tracking_q31 controller;
    for (int j = 0; j < 4; j++) {
      CHECK(anhyst_force_controller_init_map_q31(&magnet[j], &map, ANHYST_Q31_MIN,
                                                 ANHYST_Q31_MAX) == ANHYST_OK);
      drive[j] = &magnet[j];
    }
    CHECK(anhyst_tracking_init_q31(&controller, &settings, drive, 4, &filtered) == ANHYST_OK);
    for (int tick = 0; tick < SIGNALS / 4; tick++) {
      const int32_t near = any_code();
      const int32_t far = any_code();
      const int32_t gap[4] = {near, far, near, far};
      const int32_t flux[4] = {any_code(), ANHYST_NO_FLUX, any_code(), any_code()};
      const anhyst_tracking_sample_q31 sample = {edge(any_within(0, EDGE_COUNT - 1)), any_code(),
                                                 gap, flux};
      int32_t current[4];
      anhyst_tracking_answer_q31 answer = {current, 0, 0};
      anhyst_tracking_tick_q31(&controller, &sample, &answer);
      CHECK(answer.demand >= settings.pid.low && answer.demand <= settings.pid.high);
      for (int j = 0; j < 4; j++) {
        CHECK(is_drivable(&settings, current[j]));
      }
      CHECK(current[0] == current[2] && current[1] == current[3]);
    }
  }
}

/* The law of a piezo stage in both formats: a notch, an integral, feedforward, a single drive. What
   differs is rounding, most of it of the factors, to 16 bits. A reading that is no number, which
   only one of them can be given, is flagged and leaves no trace. */
static void fixed_point_controls_as_double_precision_does(void)
{
  static const int16_t line[4] = {0, 32767, 0, 32767};
  static const double straight[4] = {0.0, 1.0, 0.0, 1.0};
  const double g = 0.15;
  const double k = 1.4;
  const double d = 1.0 / (1.0 + g * (g + k));
  const double gain = 0.06;
  const anhyst_biquad_q31 filter = notch_at(g, k);
  const anhyst_biquad_f64 real_filter = {
      {(1.0 + g * g) * d, 2.0 * (g * g - 1.0) * d, (1.0 + g * g) * d},
      {2.0 * (g * g - 1.0) * d, (1.0 - g * k + g * g) * d}};
  anhyst_tracking_settings_q31 settings = {0};
  anhyst_tracking_settings_f64 real = {{{gain, 0.0, 0.0}, {-1.0, 0.0}},
                                       {0.0, ANHYST_ALLOCATE_SINGLE},
                                       0.0,
                                       1.0,
                                       0.0,
                                       &real_filter,
                                       1};
  const anhyst_map_q31 map = {line, 0, 0};
  const anhyst_map_f64 real_map = {straight, 1, 1, 0.0, 1.0, 0.0, 1.0};
  anhyst_force_controller_q31 drive;
  anhyst_force_controller_f64 real_drive;
  anhyst_force_controller_q31 *const drives[1] = {&drive};
  anhyst_force_controller_f64 *const real_drives[1] = {&real_drive};
  anhyst_biquad_state_q31 filtered;
  anhyst_biquad_state_f64 real_filtered;
  anhyst_tracking_q31 controller;
  anhyst_tracking_f64 real_controller;
  double worst = 0.0;
  settings.pid.proportional = to_factor(gain / 4.0);
  settings.pid.integral = to_factor(gain);
  settings.pid.load = to_factor(1.0 / 8.0);
  settings.pid.smoothing.mantissa = -32768;
  settings.pid.smoothing_2.mantissa = -32768;
  settings.pid.low = ANHYST_Q31_MIN;
  settings.pid.high = ANHYST_Q31_MAX;
  settings.allocation.kind = ANHYST_ALLOCATE_SINGLE;
  settings.current_high = ANHYST_Q31_MAX;
  settings.filter = &filter;
  settings.filters = 1;
  CHECK(anhyst_force_controller_init_map_q31(&drive, &map, 0, ANHYST_Q31_MAX) == ANHYST_OK);
  CHECK(anhyst_force_controller_init_map_f64(&real_drive, &real_map, 0.0, 1.0) == ANHYST_OK);
  CHECK(anhyst_tracking_init_q31(&controller, &settings, drives, 1, &filtered) == ANHYST_OK);
  CHECK(anhyst_tracking_init_f64(&real_controller, &real, real_drives, 1, &real_filtered) ==
        ANHYST_OK);
  for (int tick = 0; tick < 20000; tick++) {
    const double error = 0.01 * sin(0.3 * tick) + 0.002 * sin(0.011 * tick);
    const double forward = 0.5 + 0.3 * sin(0.004 * tick);
    const int32_t no_gap = 0;
    const int32_t no_flux = ANHYST_NO_FLUX;
    const double real_gap = 0.0;
    const double real_flux = 0.0;
    const anhyst_tracking_sample_q31 sample = {(int32_t)(error * ONE), (int32_t)(forward * ONE),
                                               &no_gap, &no_flux};
    const anhyst_tracking_sample_f64 real_sample = {error, forward, &real_gap, &real_flux};
    int32_t current;
    double real_current;
    anhyst_tracking_answer_q31 answer = {&current, 0, 0};
    anhyst_tracking_answer_f64 real_answer = {&real_current, 0.0, 0};
    if (tick % 1000 == 500) {
      const double none = tick % 2000 == 500 ? (double)NAN : -(double)INFINITY;
      const anhyst_tracking_sample_f64 lost = {none, forward, &real_gap, &real_flux};
      anhyst_tracking_tick_f64(&real_controller, &lost, &real_answer);
      CHECK(real_current == 0.0 && (real_answer.flags & ANHYST_DEMAND_LIMITED) != 0U);
    }
    anhyst_tracking_tick_q31(&controller, &sample, &answer);
    anhyst_tracking_tick_f64(&real_controller, &real_sample, &real_answer);
    CHECK(real_answer.flags == 0U);
    keep_worst(&worst, fabs(answer.demand / ONE - real_answer.demand));
    keep_worst(&worst, fabs(current / ONE - real_current) - 1.0 / 32768.0);
  }
  CHECK_BELOW("of full scale", worst, 5e-5);
}

static int is_refused(const anhyst_tracking_settings_q31 *settings, uint16_t drives)
{
  const anhyst_map_q31 map = any_map(entries, 2, 0, 8000);
  anhyst_force_controller_q31 magnet;
  anhyst_force_controller_q31 *const drive[2] = {&magnet, &magnet};
  anhyst_biquad_state_q31 filtered;
  anhyst_tracking_q31 controller;
  CHECK(anhyst_force_controller_init_map_q31(&magnet, &map, 0, 1) == ANHYST_OK);
  return anhyst_tracking_init_q31(&controller, settings, drive, drives, &filtered) ==
         ANHYST_BAD_PARAMETER;
}

static void invalid_settings_are_refused(void)
{
  anhyst_biquad_q31 filter = any_notch();
  anhyst_tracking_settings_q31 valid = any_settings(&filter);
  valid.allocation.kind = ANHYST_ALLOCATE_CLASS_AB;
  valid.current_low = 0;
  valid.current_high = 1000;
  valid.current_step = 10;
  valid.filters = 1;
  CHECK(!is_refused(&valid, 2));
  CHECK(is_refused(&valid, 0) && is_refused(&valid, 1));
  anhyst_tracking_settings_q31 wrong[6];
  for (int i = 0; i < 6; i++) {
    wrong[i] = valid;
  }
  wrong[0].allocation.kind = 4;
  wrong[1].allocation.idle = 0;
  wrong[2].current_step = 9; /* 1000 is no multiple of it */
  wrong[3].current_high = -1;
  wrong[4].pid.integral.shift = 17;
  wrong[5].current_step = -10;
  for (int i = 0; i < 6; i++) {
    CHECK(is_refused(&wrong[i], 2));
  }
  filter.loss.shift = -16;
  CHECK(is_refused(&valid, 2));
}

int main(void)
{
  class_ab_is_shared_out_as_in_exact_arithmetic();
  a_pair_of_class_a_and_a_single_drive_get_the_net_force();
  a_step_of_a_filter_is_that_of_exact_arithmetic();
  a_notch_passes_what_stands_still();
  any_filter_runs();
  any_signal_is_answered_within_the_limits();
  fixed_point_controls_as_double_precision_does();
  invalid_settings_are_refused();
  return verdict();
}
