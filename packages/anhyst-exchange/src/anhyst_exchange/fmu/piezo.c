/* SPDX-License-Identifier: Apache-2.0 */
/* A piezo stage with its controller as `anhyst simulate` runs them: the inverse model of its
 * hysteresis in fixed point, the integrator and a notch filter in double precision. */
#include "anhyst_plant/piezo.h"

#include <math.h>

#include "anhyst/compensator/force_coded_real.h"
#include "part.h"
#include "piezo_numbers.h"

enum {
  REFERENCE = 1,
  LOAD,
  NOISE,
  POSITION,
  POSITION_READ,
  EXPECTED,
  ERROR,
  DEMAND,
  VOLTAGE,
  STACK_VOLTAGE,
  VELOCITY,
  HYSTERESIS,
  CREEP
};

static const anhyst_piezo piezo = PIEZO_STAGE;
static const anhyst_biquad_f64 filters[] = PIEZO_FILTERS;
static const anhyst_tracking_settings settings = PIEZO_SETTINGS;
static const anhyst_code_scales_f64 codes = PIEZO_CODES;
static const int16_t words[] = PIEZO_WORDS;

typedef struct {
  anhyst_piezo_state stage;
  double command; /* command for the next tick, V */
  anhyst_force_controller_q31 inverse;
  anhyst_biquad_state_f64 filtered[PIEZO_FILTER_COUNT];
  anhyst_biquad_state_f64 integral;
  double ticks;
  double past_references[PIEZO_LATE_TICKS]; /* reference of the last ticks, the newest first */
} state_of;

static int build(void *tables)
{
  (void)tables;
  return 0;
}

static void drop(void *tables) { (void)tables; }

static void relink(const void *tables, void *state)
{
  anhyst_force_controller_q31 *inverse = &((state_of *)state)->inverse;
  (void)tables;
  inverse->method = &anhyst_force_by_compensator_q31;
  inverse->compensator.kernel = &PIEZO_KERNEL;
  inverse->compensator.words = words;
}

static int start(const void *tables, void *state, double *values)
{
  state_of *now = (state_of *)state;
  (void)tables;
  (void)values;
  if (anhyst_force_controller_init_compensator_q31(&now->inverse, &PIEZO_KERNEL, words,
                                                   (uint16_t)(sizeof words / sizeof *words)) !=
      ANHYST_OK) {
    return -1;
  }
  (void)anhyst_force_controller_commit_q31(&now->inverse, 0, 0); /* after a long time at 0 V */
  return 0;
}

/* Returns the reference that the sensor should show now, interpolated linearly between ticks as in
 * the simulation. */
static double delayed_reference(const state_of *now)
{
  const double at = PIEZO_TICK_S * now->ticks - PIEZO_LATENESS_S;
  int age = 0;
  double begin;
  while (age < PIEZO_LATE_TICKS - 1 && PIEZO_TICK_S * (now->ticks - age) > at) {
    age++;
  }
  begin = PIEZO_TICK_S * (now->ticks - age);
  return (now->past_references[age - 1] - now->past_references[age]) /
             (PIEZO_TICK_S * (now->ticks - (age - 1)) - begin) * (at - begin) +
         now->past_references[age];
}

static void store_reference(state_of *now, double reference)
{
  int i;
  for (i = PIEZO_LATE_TICKS - 1; i > 0; i--) {
    now->past_references[i] = now->ticks > 0.0 ? now->past_references[i - 1] : reference;
  }
  now->past_references[0] = reference;
}

static const char *tick(const void *tables, void *state, double *values, double seconds)
{
  state_of *now = (state_of *)state;
  anhyst_coded_f64 coded;
  anhyst_force_controller_f64 in_si;
  anhyst_tracking controller = {&settings, &in_si, now->filtered, now->integral};
  anhyst_piezo_loop loop = {&piezo, &controller, PIEZO_SENSOR_STEP, now->stage, now->command};
  anhyst_piezo_event event = {values[REFERENCE], 0.0, values[NOISE], values[LOAD]};
  double row[ANHYST_PIEZO_COLUMNS];
  int i;
  (void)seconds;
  for (i = REFERENCE; i <= NOISE; i++) {
    if (!(fabs(values[i]) <= 1.0)) { /* the integral could not recover from it */
      return "a reference, a load and a noise are at most 1 m";
    }
  }
  store_reference(now, event.wanted);
  event.expected = delayed_reference(now);
  relink(tables, state);
  (void)anhyst_force_controller_init_coded_f64(&in_si, &coded, &codes, &now->inverse);
  anhyst_piezo_loop_tick(&loop, &event, row);
  now->stage = loop.state;
  now->command = loop.command;
  now->integral = controller.state;
  now->ticks += 1.0;
  values[POSITION] = now->stage.place;
  values[POSITION_READ] = row[ANHYST_PIEZO_READ];
  values[EXPECTED] = event.expected;
  values[ERROR] = row[ANHYST_PIEZO_PLACE] - event.expected;
  values[DEMAND] = row[ANHYST_PIEZO_DEMAND];
  values[VOLTAGE] = row[ANHYST_PIEZO_COMMAND];
  values[STACK_VOLTAGE] = now->stage.voltage;
  values[VELOCITY] = now->stage.velocity;
  values[HYSTERESIS] = now->stage.hysteresis;
  values[CREEP] = 0.0;
  for (i = 0; i < piezo.creeps; i++) {
    values[CREEP] += now->stage.creep[i];
  }
  return isfinite(now->stage.place) && isfinite(row[ANHYST_PIEZO_READ]) &&
                 isfinite(row[ANHYST_PIEZO_DEMAND])
             ? NULL
             : "the stage has left all bounds; reset it";
}

const anhyst_part anhyst_the_part = {0, sizeof(state_of), build, drop, relink, start, tick};
