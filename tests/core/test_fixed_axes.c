/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the controller of a stage in fixed point: rows, PID, allocation, a tick. */
#include "control/axes_fixed.c" /* NOLINT(bugprone-suspicious-include): calls static functions */

#include "check.h"
#include "edges.h"
#include "maps.h"

enum { DRIVES = ANHYST_WRENCH_DRIVES, AXES = ANHYST_WRENCH_AXES, HEADS = ANHYST_AXES_HEADS };

/* Random valid words of a controller. */
static int32_t numbers[AXES * HEADS * HEADS];
static uint16_t shifts[AXES * HEADS];
static int32_t apart[DRIVES * DRIVES];
static uint16_t against[DRIVES];
static anhyst_axis_pid_q31 pids[AXES];
static int32_t reach[AXES];
static int32_t steps[AXES];

static int32_t any_edge(void)
{
  return any_within(0, 3) == 0 ? edge_number(any_within(0, EDGE_COUNT - 1)) : any_code();
}

static anhyst_axis_pid_q31 any_pid(void)
{
  const anhyst_axis_pid_q31 pid = {any_within(-ANHYST_AXIS_PID_MOST, ANHYST_AXIS_PID_MOST),
                                   any_within(-ANHYST_AXIS_PID_MOST, ANHYST_AXIS_PID_MOST),
                                   any_within(-ANHYST_AXIS_PID_MOST, ANHYST_AXIS_PID_MOST),
                                   any_within(1, ANHYST_Q31_MAX),
                                   (uint16_t)any_within(0, (int32_t)ANHYST_AXIS_PID_SHIFT)};
  return pid;
}

/* ---- rows ---- */

static void row_sum_is_rounded_once(void)
{
  double worst = 0.0;
  for (int i = 0; i < 200000; i++) {
    const uint16_t length = (uint16_t)any_within(1, ANHYST_ROW_LENGTH);
    const uint16_t shift = (uint16_t)any_within(0, (int32_t)ANHYST_ROW_SHIFT);
    int32_t row[ANHYST_ROW_LENGTH] = {0};
    int32_t signal[ANHYST_ROW_LENGTH] = {0};
    double exact = 0.0;
    for (int j = 0; j < (int)length; j++) {
      row[j] = any_within(-ANHYST_ROW_MOST, ANHYST_ROW_MOST);
      signal[j] = any_edge();
      exact += ldexp((double)row[j] * signal[j], -(int)shift);
    }
    const int32_t found = anhyst_row_product_q31(row, shift, length, signal);
    exact = fmin(fmax(exact, ANHYST_Q31_MIN), ANHYST_Q31_MAX);
    keep_largest(&worst, fabs(found - exact));
  }
  CHECK_BELOW("error of a row, in units in the last place", worst, 0.5 + 1e-4);
}

/* ---- PID ---- */

static void pid_step_matches_exact_arithmetic(void)
{
  double worst = 0.0;
  for (int i = 0; i < 400000; i++) {
    const anhyst_axis_pid_q31 pid = any_pid();
    const double most = ldexp(ANHYST_Q31_MAX, (int)pid.shift);
    const int64_t any[2] = {any_edge() * ((int64_t)1 << any_within(0, 29)),
                            any_edge() * ((int64_t)1 << any_within(0, 29))};
    anhyst_axis_pid_state_q31 state = {any[0], any[1]};
    const int32_t e = any_edge();
    const double sum = fmin(fmax((double)any[0], -most), most);
    const double asked = ldexp((double)pid.direct * e + sum + (double)any[1], -(int)pid.shift);
    const double lag = (double)any[1] * (1.0 - ldexp(pid.decay, -30)) + (double)pid.lagging * e;
    const int32_t found = step_pid(&pid, &state, e);
    keep_largest(&worst, fabs(found - fmin(fmax(asked, ANHYST_Q31_MIN), ANHYST_Q31_MAX)));
    CHECK(state.sum <= (int64_t)most && state.sum >= -(int64_t)most);
    if (fabs(lag) < ldexp(1.0, 60)) {
      CHECK(fabs((double)state.lag - lag) <= ldexp(pid.decay, -1) + 4096.0);
    } else {
      CHECK(fabs((double)state.lag) <= ldexp(1.0, 60));
    }
  }
  CHECK_BELOW("error of a step, in units of the acceleration", worst, 0.5 + 1e-4);
}

static void nothing_drifts_in_a_million_ticks_of_standstill(void)
{
  const anhyst_axis_pid_q31 pid = {435194265, 219287, -85796522, 234395592, 26};
  anhyst_axis_pid_state_q31 state = {0, 0};
  for (int i = 0; i < 500; i++) {
    (void)step_pid(&pid, &state, any_within(-100000, 100000));
  }
  const int64_t held = state.sum;
  for (int i = 0; i < 1000; i++) {
    (void)step_pid(&pid, &state, 0);
  }
  const int32_t asked = step_pid(&pid, &state, 0);
  const double lag = ldexp((double)state.lag, -26);
  for (int i = 0; i < 500000; i++) {
    CHECK(step_pid(&pid, &state, 0) == asked);
  }
  for (int i = 0; i < 250000; i++) {
    const int32_t noise = any_within(-20000, 20000);
    (void)step_pid(&pid, &state, noise);
    (void)step_pid(&pid, &state, -noise);
  }
  CHECK(held != 0 && state.sum == held);
  CHECK_BELOW("what is left of the lag, units of the acceleration", fabs(lag), 8.0);
}

/* ---- a tick ---- */

static int32_t any_current(anhyst_force_controller_q31 *c, int32_t demand, int32_t gap,
                           int32_t flux)
{
  (void)demand;
  (void)gap;
  (void)flux;
  c->flags = 0;
  return any_edge();
}

static int32_t return_applied_current(anhyst_force_controller_q31 *c, int32_t applied, int32_t gap)
{
  (void)c;
  (void)gap;
  return applied;
}

static const anhyst_force_method_q31 by_chance = {.solve = any_current,
                                                  .commit = return_applied_current};

static void fill_words(void)
{
  for (int i = 0; i < AXES * HEADS * HEADS; i++) {
    numbers[i] = any_within(-ANHYST_ROW_MOST, ANHYST_ROW_MOST) >> any_within(0, 20);
  }
  for (int i = 0; i < AXES * HEADS; i++) {
    shifts[i] = (uint16_t)any_within(0, (int32_t)ANHYST_ROW_SHIFT);
  }
  for (int i = 0; i < DRIVES * DRIVES; i++) {
    apart[i] = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE) >> any_within(0, 12);
  }
  for (int k = 0; k < AXES; k++) {
    pids[k] = any_pid();
    reach[k] = any_within(1, ANHYST_Q31_MAX);
    steps[k] = 1 + (any_within(0, ANHYST_Q31_MAX - 1) >> any_within(0, 30));
  }
}

static anhyst_wrench_layout_q31 any_layout(void)
{
  const anhyst_rows_q31 rows = {numbers, shifts};
  const int32_t most = any_within(2, ANHYST_Q31_MAX);
  const anhyst_wrench_layout_q31 layout = {
      .axes = (uint16_t)any_within(1, AXES),
      .drives = (uint16_t)any_within(1, DRIVES),
      .against = against,
      .whole = {rows, apart},
      .yields = {rows, apart},
      .pair = {any_within(1, ANHYST_Q31_MAX), ANHYST_ALLOCATE_CLASS_AB},
      .least = any_within(1 - most, most - 1),
      .most = most};
  for (int j = 0; j < DRIVES; j++) {
    against[j] = (uint16_t)j;
  }
  for (int j = 0; j + 1 < (int)layout.drives; j += any_within(1, 3)) {
    if (against[j] == j) {
      against[j] = (uint16_t)(j + 1);
      against[j + 1] = (uint16_t)j;
      j++;
    }
  }
  return layout;
}

static anhyst_axes_settings_q31 any_settings(void)
{
  const anhyst_rows_q31 rows = {numbers, shifts};
  const int32_t step = any_within(1, 100000);
  const int32_t low = any_within(-ANHYST_Q30_ONE, ANHYST_Q30_ONE - 1);
  fill_words();
  anhyst_axes_settings_q31 settings = {
      .layout = any_layout(),
      .see = rows,
      .decouple = rows,
      .weigh = rows,
      .pid = pids,
      .reach = reach,
      .current_low = low,
      .current_high = low + any_within(0, (ANHYST_Q31_MAX - ANHYST_Q30_ONE) / step) * step,
      .current_step = step,
      .follow = any_within(0, ANHYST_Q31_MAX),
      .slew = any_within(0, ANHYST_Q31_MAX),
      .off = any_within(0, ANHYST_Q31_MAX),
      .off_ticks = (uint16_t)any_within(1, 20),
      .spare = (uint16_t)any_code(),
      .land_ticks = (uint16_t)any_within(0, 50),
      .land = steps,
      .lift = steps,
      .without = rows,
      .spare_heads = (uint16_t)any_code(),
      .jump = any_within(0, ANHYST_Q31_MAX),
      .doubt = (uint16_t)any_within(1, 100),
      .noisy = (uint16_t)any_within(0, 1)};
  settings.heads = (uint16_t)any_within((int32_t)settings.layout.axes, HEADS);
  return settings;
}

/* Checks the forces for random words and a random wrench, with some drives lost. */
static void check_forces(const anhyst_wrench_layout_q31 *layout, const anhyst_wrench_q31 *w,
                         const int32_t *force)
{
  for (int j = 0; j < (int)layout->drives; j++) {
    const int lost = (int)(w->lost >> j & 1U);
    const int alone = against[j] == j || (w->lost >> against[j] & 1U);
    CHECK(!lost || force[j] == 0);
    CHECK(lost || force[j] >= (alone ? layout->least : 0));
  }
}

static void any_tick(anhyst_axes_q31 *c)
{
  int32_t head[HEADS];
  int32_t forward[AXES];
  int32_t gap[DRIVES];
  int32_t read[DRIVES];
  int32_t current[DRIVES];
  int32_t demand[AXES];
  const anhyst_axes_settings_q31 *settings = c->settings;
  const anhyst_axes_sample_q31 sample = {
      head, forward, gap, gap, read, (uint16_t)(any_within(0, 3) ? 0 : any_within(0, 9)), NULL};
  anhyst_axes_answer_q31 out = {current, demand, 0, 0, 0};
  for (int j = 0; j < HEADS; j++) {
    head[j] = any_edge() >> any_within(0, 31);
    gap[j] = any_edge();
    read[j] = any_within(0, 1) ? any_edge() : c->commanded_current[j];
  }
  for (int k = 0; k < AXES; k++) {
    forward[k] = any_edge();
  }
  anhyst_axes_tick_q31(c, &sample, &out);
  for (int j = 0; j < (int)settings->layout.drives; j++) {
    CHECK(current[j] >= settings->current_low && current[j] <= settings->current_high);
    CHECK((int64_t)(current[j] - (int64_t)settings->current_low) % settings->current_step == 0);
  }
  anhyst_wrench_share_q31(&c->allocator, demand, read);
  check_forces(&settings->layout, &c->allocator, read);
}

static void currents_stay_within_limits_for_any_input(void)
{
  anhyst_force_controller_q31 magnet[DRIVES] = {{0}};
  anhyst_force_controller_q31 *drive[DRIVES];
  int flown = 0;
  for (int j = 0; j < DRIVES; j++) {
    magnet[j].method = &by_chance;
    drive[j] = &magnet[j];
  }
  for (int i = 0; i < 1500; i++) {
    const anhyst_axes_settings_q31 settings = any_settings();
    anhyst_axes_q31 c;
    CHECK(anhyst_axes_init_q31(&c, &settings, drive) == ANHYST_OK);
    for (int tick = 0; tick < 60; tick++) {
      any_tick(&c);
      flown += c.flight_state != ANHYST_AXES_REST;
    }
  }
  CHECK(flown > 10000);
}

static void missing_sample_does_not_change_the_pid(void)
{
  anhyst_force_controller_q31 magnet[DRIVES] = {{0}};
  anhyst_force_controller_q31 *drive[DRIVES];
  int held = 0;
  for (int j = 0; j < DRIVES; j++) {
    magnet[j].method = &by_chance;
    drive[j] = &magnet[j];
  }
  for (int i = 0; i < 300; i++) {
    anhyst_axes_settings_q31 settings = any_settings();
    int32_t silent[HEADS] = {0};
    int32_t none[DRIVES] = {0};
    int32_t demand[AXES];
    anhyst_axes_q31 c;
    anhyst_axes_answer_q31 out = {none, demand, 0, 0, 0};
    settings.off = 0;
    settings.jump = 0;
    CHECK(anhyst_axes_init_q31(&c, &settings, drive) == ANHYST_OK);
    any_tick(&c);
    const anhyst_axis_pid_state_q31 before = c.pid_state[0];
    silent[any_within(0, (int32_t)settings.heads - 1)] = ANHYST_Q31_MIN;
    const anhyst_axes_sample_q31 sample = {silent, none, none, none, none, 0, NULL};
    anhyst_axes_tick_q31(&c, &sample, &out);
    CHECK(out.flags & ANHYST_SAMPLE_IMPLAUSIBLE);
    if (c.flight_state == ANHYST_AXES_FLY) {
      CHECK(c.pid_state[0].sum == before.sum && c.pid_state[0].lag == before.lag);
      held++;
    }
  }
  CHECK(held > 100);
}

/* Checks that one word out of its range is rejected. */
static void check_refused(const anhyst_axes_settings_q31 *settings, int32_t *word, int32_t value)
{
  const int32_t kept = *word;
  anhyst_axes_q31 c;
  *word = value;
  CHECK(anhyst_axes_init_q31(&c, settings, NULL) == ANHYST_BAD_PARAMETER);
  *word = kept;
}

static void words_out_of_range_are_refused(void)
{
  anhyst_axes_settings_q31 settings = any_settings();
  anhyst_axes_q31 c;
  settings.layout.axes = 1;
  CHECK(anhyst_axes_init_q31(&c, &settings, NULL) == ANHYST_OK);
  check_refused(&settings, &numbers[0], ANHYST_ROW_MOST + 1);
  check_refused(&settings, &apart[0], ANHYST_Q30_ONE + 1);
  check_refused(&settings, &pids[0].decay, 0);
  check_refused(&settings, &pids[0].direct, ANHYST_AXIS_PID_MOST + 1);
  check_refused(&settings, &reach[0], 0);
  check_refused(&settings, &steps[0], 0);
  check_refused(&settings, &settings.current_step, 0);
  check_refused(&settings, &settings.follow, -1);
  check_refused(&settings, &settings.layout.most, settings.layout.least);
  shifts[0] = ANHYST_ROW_SHIFT + 1U;
  CHECK(anhyst_axes_init_q31(&c, &settings, NULL) == ANHYST_BAD_PARAMETER);
}

int main(void)
{
  row_sum_is_rounded_once();
  pid_step_matches_exact_arithmetic();
  nothing_drifts_in_a_million_ticks_of_standstill();
  currents_stay_within_limits_for_any_input();
  missing_sample_does_not_change_the_pid();
  words_out_of_range_are_refused();
  return verdict();
}
