/* SPDX-License-Identifier: Apache-2.0 */
/* Claims about the services for boards. A set in flash survives a power failure at any byte, a
   calibration saturates, and the I^2 t protection trips and clears at the calculated times. */
#include "../core/check.h"
#include "services/calibration.h"
#include "services/store.h"
#include "services/thermal.h"

#include <string.h>

/* Flash with two copies. It works byte by byte, and the power may fail after any byte. */
enum { WORDS = 24, BYTES = 4 * WORDS, SET = 13 };

static uint32_t memory[2][WORDS];
static long steps_left;
static uint32_t rubbish;

static int use_power(void)
{
  if (steps_left == 0) {
    return 0;
  }
  steps_left--;
  return 1;
}

static uint32_t random_word(void)
{
  rubbish ^= rubbish << 13;
  rubbish ^= rubbish >> 17;
  rubbish ^= rubbish << 5;
  return rubbish;
}

/* After an interrupted erase, bits that were 0 have any value. */
static int erase(uint16_t copy)
{
  for (int i = 0; i < WORDS; i++) {
    if (!use_power()) {
      for (int j = i; j < WORDS; j++) {
        memory[copy][j] |= random_word();
      }
      return 0;
    }
    memory[copy][i] = 0xFFFFFFFFU;
  }
  return 1;
}

/* A write only clears bits. If it is interrupted, it clears some bits of the present byte. */
static int program(uint16_t copy, uint32_t at, uint32_t word)
{
  for (unsigned byte = 0; byte < 4U; byte++) {
    const uint32_t mask = (uint32_t)0xFFU << (8U * byte);
    if (!use_power()) {
      memory[copy][at] &= (word | ~mask) | random_word();
      return 0;
    }
    memory[copy][at] &= word | ~mask;
  }
  return 1;
}

static const store_flash flash = {{memory[0], memory[1]}, WORDS, erase, program};

/* Makes a set that its first word identifies. */
static void make_set(uint32_t *set, uint32_t name, uint32_t count)
{
  for (uint32_t i = 0; i < count; i++) {
    set[i] = name + 0x01010101U * i * i;
  }
}

static int reads_set(uint32_t name, uint32_t count)
{
  uint32_t expected[WORDS];
  uint32_t found = 0;
  const volatile uint32_t *set = store_read(&flash, &found);
  if (set == NULL || found != count) {
    return 0;
  }
  make_set(expected, name, count);
  for (uint32_t i = 0; i < count; i++) {
    if (set[i] != expected[i]) {
      return 0;
    }
  }
  return 1;
}

static int writes_set(uint32_t name, uint32_t count)
{
  uint32_t set[WORDS];
  make_set(set, name, count);
  return store_write(&flash, set, count);
}

static void start_with_empty_flash(void)
{
  memset(memory, 0xFF, sizeof memory);
  steps_left = -1;
}

static void a_set_is_read_back(void)
{
  uint32_t count = 1;
  start_with_empty_flash();
  CHECK(store_read(&flash, &count) == NULL && count == 0);
  for (uint32_t name = 1; name < 9; name++) {
    CHECK(writes_set(name, name));
    CHECK(reads_set(name, name));
  }
  CHECK(writes_set(9, WORDS - STORE_OVERHEAD_WORDS));
  CHECK(reads_set(9, WORDS - STORE_OVERHEAD_WORDS));
  CHECK(!writes_set(10, WORDS - STORE_OVERHEAD_WORDS + 1));
  CHECK(reads_set(9, WORDS - STORE_OVERHEAD_WORDS));
  CHECK(writes_set(11, 0));
  CHECK(reads_set(11, 0));
}

/* Writes to a flash with none, one or two sets, interrupts after every step, and writes again. */
static long interrupt_after_every_step(int sets)
{
  long steps = 0;
  for (;; steps++) {
    uint32_t count;
    start_with_empty_flash();
    for (int i = 0; i < sets; i++) {
      CHECK(writes_set(100U + (uint32_t)i, SET));
    }
    const uint32_t before = 100U + (uint32_t)sets - 1U;
    steps_left = steps;
    const int told = writes_set(200, SET - 2);
    const int cut = steps_left == 0 && !told;
    steps_left = -1;
    const int old = sets > 0 ? reads_set(before, SET) : store_read(&flash, &count) == NULL;
    const int new = reads_set(200, SET - 2);
    CHECK(old != new);
    CHECK(new || !told);
    CHECK(writes_set(300, SET));
    CHECK(reads_set(300, SET));
    if (!cut) {
      CHECK(told && new);
      return steps;
    }
  }
}

static void interruption_leaves_the_old_or_the_new_set(void)
{
  for (rubbish = 1; rubbish < 2000000000U; rubbish += 61234567U) {
    const uint32_t seed = rubbish;
    for (int sets = 0; sets < 4; sets++) {
      CHECK(interrupt_after_every_step(sets) == WORDS + 4L * (SET - 2 + STORE_OVERHEAD_WORDS));
    }
    rubbish = seed;
  }
}

static void set_number_that_wraps_is_still_newer(void)
{
  uint32_t count = 1;
  start_with_empty_flash();
  memory[0][0] = STORE_MAGIC;
  memory[0][1] = 0xFFFFFFFFU;
  memory[0][2] = 0;
  memory[0][3] = 0xC02EFFBEU; /* CRC-32 of these three words, by zlib */
  CHECK(store_read(&flash, &count) != NULL && count == 0);
  CHECK(writes_set(7, 3));
  CHECK(memory[1][1] == 0);
  CHECK(reads_set(7, 3));
}

static void damage_is_detected(void)
{
  start_with_empty_flash();
  CHECK(writes_set(1, SET));
  CHECK(writes_set(2, SET));
  for (int bit = 0; bit < 8 * 4 * (SET + STORE_OVERHEAD_WORDS); bit++) {
    memory[1][bit / 32] ^= (uint32_t)1 << (bit % 32);
    CHECK(reads_set(1, SET));
    memory[1][bit / 32] ^= (uint32_t)1 << (bit % 32);
  }
  CHECK(reads_set(2, SET));
}

static void a_calibration_rounds_and_saturates(void)
{
  calibration c = {410, 327760, 0, 80, 4015};
  CHECK(calibration_is_valid(&c));
  CHECK(calibration_value(&c, 410) == 0);
  CHECK(calibration_value(&c, 3686) == 3276 * 327760);
  CHECK(calibration_value(&c, 79) == CALIBRATION_NONE);
  CHECK(calibration_value(&c, 4016) == CALIBRATION_NONE);
  c.low = INT32_MIN;
  c.high = INT32_MAX;
  CHECK(calibration_value(&c, INT32_MAX) == INT32_MAX);
  CHECK(calibration_value(&c, INT32_MIN) == -INT32_MAX);
  c = (calibration){INT32_MAX, -CALIBRATION_MAX_MANTISSA, 46, INT32_MIN, INT32_MAX};
  CHECK(calibration_is_valid(&c));
  CHECK(calibration_value(&c, INT32_MIN) == 65536);
  c = (calibration){0, 1, 1, -10, 10};
  CHECK(calibration_value(&c, 1) == 1 && calibration_value(&c, -1) == 0);
  c.mantissa = 0;
  CHECK(!calibration_is_valid(&c));
  c = (calibration){0, 1, 47, -10, 10};
  CHECK(!calibration_is_valid(&c));
  c = (calibration){0, 1, 1, 10, 10};
  CHECK(!calibration_is_valid(&c));
}

#define ONE ((int32_t)1073741824)

static void winding_trips_and_clears_at_the_calculated_times(void)
{
  thermal_plan plan;
  thermal t;
  CHECK(!thermal_prepare(&plan, 1, ONE, ONE / 2));
  CHECK(!thermal_prepare(&plan, 1000, ONE / 2, ONE / 2));
  CHECK(!thermal_prepare(&plan, 1000, ONE, 0));
  CHECK(thermal_prepare(&plan, 100000, ONE / 2, ONE / 4));
  thermal_start(&t, &plan);
  long tick = 0;
  while (!thermal_tick(&t, &plan, ONE)) {
    tick++;
  }
  /* From 1/16 towards 1 past 1/4: ln((1 - 1/16)/(1 - 1/4)) time constants. */
  CHECK_BELOW("ticks off", fabs((double)tick - 100000.0 * log(1.25)), 2.0);
  tick = 0;
  while (thermal_tick(&t, &plan, 0)) {
    tick++;
  }
  CHECK_BELOW("ticks off", fabs((double)tick - 100000.0 * log(4.0)), 2.0);
}

static void allowed_constant_current_never_trips(void)
{
  thermal_plan plan;
  thermal t;
  CHECK(thermal_prepare(&plan, 2, ONE / 2, ONE / 4));
  thermal_start(&t, &plan);
  for (int i = 0; i < 1000; i++) {
    CHECK(!thermal_tick(&t, &plan, i % 2 == 0 ? ONE / 2 : -ONE / 2));
  }
  CHECK_BELOW("short of the square", ldexp((double)(plan.trip_warmth - t.warmth), -60),
              ldexp(1.0, -28));
  /* A value that is not a current counts as the largest current. */
  CHECK(thermal_tick(&t, &plan, INT32_MIN));
}

int main(void)
{
  a_set_is_read_back();
  interruption_leaves_the_old_or_the_new_set();
  set_number_that_wraps_is_still_newer();
  damage_is_detected();
  a_calibration_rounds_and_saturates();
  winding_trips_and_clears_at_the_calculated_times();
  allowed_constant_current_never_trips();
  return verdict();
}
