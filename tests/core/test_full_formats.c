/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the Jiles-Atherton law in fixed point, f32 and f64 together: the formats agree on
   random paths, none of them drifts at rest, and damaged states and signals do no harm. An argument
   may give the number of ticks at rest. */
#include <string.h>

#include "anhyst/compensator/compensator.h"
#include "anhyst/compensator/compensator_f32.h"
#include "anhyst/compensator/compensator_f64.h"

#include "check.h"
#include "full_words.h"

enum { STEPS = 100000, WORDS = sizeof words / sizeof words[0] };

static float words_f32[WORDS];
static double words_f64[WORDS];

/* Returns the value of a word of the block in floating point. */
static double word_as_number(int word)
{
  switch (word) {
  case ANHYST_WORD_FULL_AIR:
    return words[word] / 65536.0;
  case ANHYST_WORD_FULL_RATE:
    return words[word] / 65536.0 * pow(2.0, words[ANHYST_WORD_FULL_RATE_SHIFT]);
  case ANHYST_WORD_FULL_RATE_SHIFT:
    return 0.0;
  case ANHYST_WORD_FULL_STEEPNESS:
    return words[word] / 256.0;
  case ANHYST_WORD_FULL_ITERATIONS:
  case ANHYST_WORD_FULL_CURVE_SEGMENTS:
  case ANHYST_WORD_FULL_CURVE:
  case ANHYST_WORD_FULL_BRANCH:
  case ANHYST_WORD_FULL_INVERSE_SEGMENTS:
  case ANHYST_WORD_FULL_INVERSE:
    return words[word];
  default:
    return words[word] / 32768.0;
  }
}

static void fill_block(void)
{
  prepare_law(0.5, 0.2, 0.15);
  words[ANHYST_WORD_FULL_AIR] = 300;
  words[ANHYST_WORD_FULL_ITERATIONS] = 8;
  words[ANHYST_WORD_CURRENT_LOW] = -32767;
  words[ANHYST_WORD_CURRENT_HIGH] = 32767;
  for (int i = 0; i < (int)WORDS; i++) {
    words_f64[i] = word_as_number(i);
    words_f32[i] = (float)words_f64[i];
  }
}

#define LAW_FORMATS                                                                                \
  FORMAT(fixed, anhyst_compensator, anhyst_arms, anhyst_kernel_full, int32_t, words, 1073741824.0, \
         weight_of)                                                                                \
  FORMAT(f32, anhyst_compensator_f32, anhyst_arms_f32, anhyst_kernel_full_f32, float, words_f32,   \
         1.0, single_of)                                                                           \
  FORMAT(f64, anhyst_compensator_f64, anhyst_arms_f64, anhyst_kernel_full_f64, double, words_f64,  \
         1.0, double_of)
#include "law_formats.h"

/* The gap changes the coefficients. A third of the currents is rounded to a converter of 12 bits,
   and sometimes another current is applied. An error of a step decays along the path. */
static void formats_agree_on_random_paths(int arm)
{
  uint64_t seed = 3;
  double flux = 0.0;
  double field_error[2] = {0.0, 0.0};
  double flux_error[2] = {0.0, 0.0};
  double squares[2] = {0.0, 0.0};
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS; i++) {
    flux = next_flux(flux, 0.8, &seed);
    flux_arm = arm - (int)(random_bits(&seed) % 1000U);
    field_arm = 16000 + (int)(random_bits(&seed) % 1000U);
    const double x = f64_field(flux);
    const double errors[2] = {fabs(fixed_field(flux) - x), fabs(f32_field(flux) - x)};
    for (int which = 0; which < 2; which++) {
      keep_largest(&field_error[which], errors[which]);
      squares[which] += errors[which] * errors[which] / (double)STEPS;
    }
    double current = double_of(flux_arm) * flux + double_of(field_arm) * x;
    current = i % 3 == 0 ? floor(current * 4096.0) / 4096.0 : rounded(current);
    current = i % 17 == 0 ? rounded(uniform(&seed, -0.2, 0.2)) : current;
    if (i % 3 != 1) {
      flux = f64_flux(current);
      keep_largest(&flux_error[0], fabs(fixed_flux(current) - flux));
      keep_largest(&flux_error[1], fabs(f32_flux(current) - flux));
    }
    fixed_keep();
    f32_keep();
    f64_keep();
  }
  CHECK_BELOW("field, fixed point", field_error[0], 6e-3);
  CHECK_BELOW("field, f32", field_error[1], 6e-3);
  CHECK_BELOW("field, fixed point, root mean square", sqrt(squares[0]), 2e-4);
  CHECK_BELOW("field, f32, root mean square", sqrt(squares[1]), 2e-4);
  CHECK_BELOW("flux, fixed point", flux_error[0], 2e-3);
  CHECK_BELOW("flux, f32", flux_error[1], 2e-3);
}

/* Noise of demand and gap widens the range of the path only in its first ticks. */
static void no_format_drifts_at_rest(const format *law, long ticks)
{
  const double flux = 0.4;
  double drift = 0.0;
  for (int way = 0; way < 4; way++) {
    uint64_t seed = 9;
    double first = 0.0;
    flux_arm = 12000;
    field_arm = 16000;
    approach_demand(law, flux, way / 2);
    for (long i = 0; i <= ticks; i++) {
      flux_arm = 12000 - (int)(random_bits(&seed) % 4U);
      (void)tick(law, rounded(flux + uniform(&seed, -1.3e-4, 1.3e-4)), way % 2);
      if (i == ticks / 4 || i == ticks) {
        flux_arm = 12000;
        const double current = tick(law, flux, way % 2);
        keep_largest(&drift, i == ticks ? fabs(current - first) : 0.0);
        first = current;
      }
    }
  }
  printf("%s: ", law->name);
  CHECK_BELOW("drift of the current at rest", drift, 2e-6);
}

/* Without noise, the state stays exactly the same. */
static void constant_demand_changes_no_state(void)
{
  uint64_t seed = 21;
  int changes = 0;
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS / 10; i++) {
    const double flux = next_flux(fixed.flux / 1073741824.0, 0.8, &seed);
    for (int more = 0; more < 4; more++) {
      (void)tick(&FORMATS[0], flux, 0);
      (void)tick(&FORMATS[1], flux, 0);
    }
    const anhyst_full_memory memory = fixed.memory.full;
    const anhyst_full_memory_f32 memory_f32 = f32.memory.full;
    (void)tick(&FORMATS[0], flux, 0);
    (void)tick(&FORMATS[1], flux, 0);
    changes += memcmp(&memory, &fixed.memory.full, sizeof memory) != 0;
    changes += memcmp(&memory_f32, &f32.memory.full, sizeof memory_f32) != 0;
  }
  CHECK_BELOW("ticks of a constant demand in which the memory changes, share",
              changes / ((double)STEPS / 5.0), 1e-3);
}

/* Fields and fluxes stay finite and in their range. No word outside the block is read, as
   sanitizers check. */
static void damaged_words_and_nan_signals_do_no_harm(void)
{
  const double odd[4] = {(double)NAN, (double)INFINITY, -(double)INFINITY, 1e30};
  uint64_t seed = 77;
  int wrong = 0;
  fixed_start();
  f32_start();
  f64_start();
  for (int i = 0; i < STEPS; i++) {
    const uint64_t choice = random_bits(&seed);
    const double flux = uniform(&seed, -0.9, 0.9);
    const double current = choice % 5U == 0U ? odd[choice / 5U % 4U] : uniform(&seed, -0.3, 0.3);
    flux_arm = i % 2 == 0 ? 12000 : -2000;
    (void)fixed_field(flux);
    (void)f32_field(flux);
    (void)f64_field(flux);
    damage_word(&fixed.memory, sizeof fixed.memory, &seed);
    damage_word(&fixed.next, sizeof fixed.next, &seed);
    damage_word(&f32.memory, sizeof f32.memory, &seed);
    damage_word(&f32.next, sizeof f32.next, &seed);
    damage_word(&f64.memory, sizeof f64.memory, &seed);
    damage_word(&f64.next, sizeof f64.next, &seed);
    (void)fixed_flux(choice % 5U == 0U ? 0.9 : current);
    wrong += !(fabs(f32_flux(current)) <= 4.0) + !(fabs(f64_flux(current)) <= 4.0);
    fixed_keep();
    f32_keep();
    f64_keep();
    f32.stage = f64.stage = fixed.stage = (uint16_t)(choice / 64U % 3U);
    (void)fixed_field(flux);
    wrong += !(fabs(f32_field(flux)) <= 1.0) + !(fabs(f64_field(flux)) <= 1.0);
  }
  CHECK(wrong == 0);
}

int main(int count, char **arguments)
{
  const long ticks = count > 1 ? strtol(arguments[1], NULL, 10) : STEPS;
  fill_block();
  formats_agree_on_random_paths(12000);
  formats_agree_on_random_paths(-2000);
  for (int law = 0; law < 3; law++) {
    no_format_drifts_at_rest(&FORMATS[law], ticks);
  }
  constant_demand_changes_no_state();
  damaged_words_and_nan_signals_do_no_harm();
  return verdict();
}
