/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the simplified law in all formats: they agree within the rounding of 16-bit words,
   small steps and reversals within the dead band accumulate nothing, and damaged numbers never lead
   outside -1..1. All formats use the numbers of the same fixed-point block. */
#include <string.h>

#include "anhyst/compensator/compensator.h"
#include "anhyst/compensator/compensator_f32.h"
#include "anhyst/compensator/compensator_f64.h"

#include "check.h"
#include "truth.h"

enum { SEGMENTS = 16, OCTAVES = 12, ENTRIES = (OCTAVES + 1) * SEGMENTS + 1 };
enum { CURVE = ANHYST_BLOCK_LEAST_WORDS, ARMS = CURVE + ENTRIES, WORDS = ARMS + 2 };
static const double FULL_Q30 = 1073741824.0;
static const double RATE = 1.4;
static const double REST = 0.06; /* 1 - nu */
static const double FLUX_ARM = 0.21;
static const double FIELD_ARM = 0.05;
static const double BAND = 0.0005;

static int16_t fixed_words[WORDS];
static float f32_words[WORDS];
static double f64_words[WORDS];
static anhyst_compensator fixed;
static anhyst_compensator_f32 f32;
static anhyst_compensator_f64 f64;

/* Sets a number in all blocks, rounded to a word in which 1.0 is `one`. */
static void set_number(int word, double value, double one)
{
  fixed_words[word] = (int16_t)lrint(fmin(value * one, 32767.0));
  f64_words[word] = fixed_words[word] / one;
  f32_words[word] = (float)f64_words[word];
}

/* Sets a weight, and its exponent in the next word. */
static void set_weight(int word, double value, int shift)
{
  set_number(word, value / pow(2.0, shift), 65536.0);
  set_number(word + 1, 0.0, 1.0);
  fixed_words[word + 1] = (int16_t)shift;
  f64_words[word] *= pow(2.0, shift);
  f32_words[word] = (float)f64_words[word];
}

/* Returns 1 - v at a distance, by bisection. */
static double state_at(double z)
{
  double low = 1e-12;
  double high = 1.0;
  for (int i = 0; i < 60; i++) {
    const double v = sqrt(low * high);
    if (-log(v) + (1.0 - REST) * (v - 1.0) > z) {
      low = v;
    } else {
      high = v;
    }
  }
  return 1.0 - low;
}

static void make_blocks(void)
{
  set_number(ANHYST_WORD_LENGTH, WORDS, 1.0);
  set_number(ANHYST_WORD_GAP_FLUX_ARM, ARMS, 1.0);
  set_weight(ANHYST_WORD_SIMPLE_RATE, RATE / 8.0, 0);
  set_weight(ANHYST_WORD_SIMPLE_HOLD, RATE / REST, 6);
  set_number(ANHYST_WORD_SIMPLE_REST, REST, 32768.0);
  set_number(ANHYST_WORD_SIMPLE_BAND, BAND, 65536.0);
  set_number(ANHYST_WORD_SIMPLE_ITERATIONS, 16.0, 1.0);
  set_number(ANHYST_WORD_SIMPLE_OCTAVES, OCTAVES, 1.0);
  set_number(ANHYST_WORD_SIMPLE_SEGMENTS, 4.0, 1.0);
  set_number(ANHYST_WORD_SIMPLE_CURVE, CURVE, 1.0);
  for (int i = 0; i < ENTRIES; i++) {
    const double inside = i % SEGMENTS / (double)SEGMENTS;
    const double first = 16.0 / pow(2.0, OCTAVES);
    const int octave = i / SEGMENTS;
    const double z = octave == 0 ? inside * first : first * pow(2.0, octave - 1) * (1.0 + inside);
    set_number(CURVE + i, state_at(z), 32768.0);
  }
  set_number(ARMS, FLUX_ARM, 65536.0);
  set_number(ARMS + 1, FLUX_ARM, 65536.0);
  CHECK(anhyst_kernel_simplified.valid(fixed_words));
  CHECK(anhyst_kernel_simplified_f32.valid(f32_words));
  CHECK(anhyst_kernel_simplified_f64.valid(f64_words));
}

static void demagnetise(void)
{
  const anhyst_arms arms = {0, (int16_t)lrint(FLUX_ARM * 65536.0),
                            (int16_t)lrint(FIELD_ARM * 65536.0)};
  memset(&fixed, 0, sizeof fixed);
  memset(&f32, 0, sizeof f32);
  memset(&f64, 0, sizeof f64);
  fixed.words = fixed_words;
  f32.words = f32_words;
  f64.words = f64_words;
  fixed.arms = arms;
  f64.arms.flux_arm = arms.flux_arm / 65536.0;
  f64.arms.field_arm = arms.field_arm / 65536.0;
  f32.arms.flux_arm = (float)f64.arms.flux_arm;
  f32.arms.field_arm = (float)f64.arms.field_arm;
}

/* Result of each format after a step. */
typedef struct {
  double fixed;
  double f32;
  double f64;
} states;

static void keep_steps(void)
{
  fixed.memory = fixed.next.memory;
  f32.memory = f32.next.memory;
  f64.memory = f64.next.memory;
}

/* The trial step of each format to a flux that all formats represent exactly, |flux| <= 1. */
static states solve_for(double flux)
{
  fixed.flux = (int32_t)lrint(flux * FULL_Q30);
  f32.flux = (float)flux;
  f64.flux = flux;
  const states found = {anhyst_kernel_simplified.field(&fixed) / FULL_Q30,
                        (double)anhyst_kernel_simplified_f32.field(&f32),
                        anhyst_kernel_simplified_f64.field(&f64)};
  return found;
}

static states step_to(double flux)
{
  const states found = solve_for(flux);
  keep_steps();
  return found;
}

/* Commits a step at a current, which may begin at the trial step, and returns the fluxes. */
static states step_at_current(double current)
{
  fixed.stage = ANHYST_STAGE_AHEAD;
  f32.stage = ANHYST_STAGE_AHEAD;
  f64.stage = ANHYST_STAGE_AHEAD;
  const states found = {anhyst_kernel_simplified.flux(&fixed, (int32_t)lrint(current * FULL_Q30)) /
                            FULL_Q30,
                        (double)anhyst_kernel_simplified_f32.flux(&f32, (float)current),
                        anhyst_kernel_simplified_f64.flux(&f64, current)};
  keep_steps();
  return found;
}

/* Returns the next flux of a random path: long and short steps, reversals within and beyond the
   dead band; on a grid of 2^-22. */
static double next_flux(uint64_t *seed, double flux)
{
  const double reach = log_uniform(seed, 1e-5, 1.0);
  const double next = flux + uniform(seed, -reach, reach);
  return ldexp(rint(ldexp(fmax(-0.95, fmin(0.95, next)), 22)), -22);
}

static void formats_agree_on_any_path_of_the_flux(void)
{
  uint64_t seed = 5;
  double flux = 0.0;
  double of_fixed = 0.0;
  double of_f32 = 0.0;
  demagnetise();
  for (int i = 0; i < 200000; i++) {
    flux = next_flux(&seed, flux);
    const states found = step_to(flux);
    keep_largest(&of_fixed, fabs(found.fixed - found.f64));
    keep_largest(&of_f32, fabs(found.f32 - found.f64));
  }
  CHECK_BELOW("state of fixed point against f64", of_fixed, 2e-5);
  CHECK_BELOW("state of f32 against f64", of_f32, 2e-5);
}

static void formats_agree_on_any_path_of_the_current(void)
{
  uint64_t seed = 7;
  double flux = 0.0;
  double of_fixed = 0.0;
  double of_f32 = 0.0;
  double missing = 0.0;
  demagnetise();
  for (int i = 0; i < 200000; i++) {
    flux = next_flux(&seed, flux);
    const double current = 0.18 * flux; /* field of a flux below 1 in any state */
    (void)solve_for(next_flux(&seed, flux));
    const states found = step_at_current(current);
    keep_largest(&of_fixed, fabs(found.fixed - found.f64));
    keep_largest(&of_f32, fabs(found.f32 - found.f64));
    f64.flux = found.f64;
    const double field = anhyst_kernel_simplified_f64.field(&f64);
    keep_largest(&missing,
                 fabs(current - f64.arms.flux_arm * found.f64 - f64.arms.field_arm * field));
  }
  CHECK_BELOW("flux of fixed point against f64", of_fixed, 5e-5);
  CHECK_BELOW("flux of f32 against f64", of_f32, 2e-5);
  CHECK_BELOW("current of f64 that its flux does not explain", missing, 1e-6);
}

static states path_to(double flux, int steps)
{
  states found = {0.0, 0.0, 0.0};
  for (int i = 1; i <= steps; i++) {
    found = step_to(ldexp(rint(ldexp(flux * i / steps, 22)), -22));
  }
  return found;
}

static void small_steps_accumulate_nothing(void)
{
  demagnetise();
  const states fine = path_to(0.5, 1 << 20);
  demagnetise();
  const states whole = path_to(0.5, 1);
  CHECK(fine.fixed == whole.fixed && fine.f32 == whole.f32 && fine.f64 == whole.f64);
}

/* Moves the flux within the dead band after a rise or a descent. */
static void reversals_within_the_dead_band_change_no_state(double way)
{
  uint64_t seed = 3;
  demagnetise();
  (void)step_to(-way);
  (void)step_to(way);
  const states before = step_to(way / 2.0);
  for (int i = 0; i < 1000000; i++) {
    const double back = ldexp((double)(random_bits(&seed) % 2000U), -22); /* below BAND */
    (void)step_to(way / 2.0 + (way > 0.0 ? back : -back));
  }
  const states after = step_to(way / 2.0);
  CHECK(after.fixed == before.fixed && after.f32 == before.f32 && after.f64 == before.f64);
  (void)step_to(way / 2.0 + (way > 0.0 ? 0.01 : -0.01));
  CHECK(fabs(step_to(way / 2.0).f64) < fabs(before.f64)); /* beyond the dead band */
}

/* Any words in the memory and in the trial step give states in -1..1 and no endless loop. */
static void damaged_numbers_stay_within_their_bounds(void)
{
  uint64_t seed = 11;
  const double bound = 1.0;
  for (int i = 0; i < 200000; i++) {
    demagnetise();
    uint64_t noise[16];
    for (int k = 0; k < 16; k++) {
      noise[k] = random_bits(&seed) ^ (random_bits(&seed) << 32);
    }
    memcpy(&fixed.memory, noise, sizeof fixed.memory);
    memcpy(&f32.memory, noise, sizeof f32.memory);
    memcpy(&f64.memory, noise, sizeof f64.memory);
    memcpy(&fixed.next.memory, noise + 5, sizeof fixed.memory);
    memcpy(&f32.next.memory, noise + 5, sizeof f32.memory);
    memcpy(&f64.next.memory, noise + 5, sizeof f64.memory);
    f32.memory.simplified.flux = i % 7 == 0 ? (float)NAN : f32.memory.simplified.flux;
    f64.memory.simplified.start_state =
        i % 5 == 0 ? (double)NAN : f64.memory.simplified.start_state;
    const states under = step_at_current(uniform(&seed, -2.0, 2.0) * 0.9);
    const states to = step_to(next_flux(&seed, 0.0));
    CHECK(fabs(under.fixed) <= bound && fabs(under.f32) <= bound && fabs(under.f64) <= bound);
    CHECK(fabs(to.fixed) <= bound && fabs(to.f32) <= bound && fabs(to.f64) <= bound);
  }
}

int main(void)
{
  make_blocks();
  formats_agree_on_any_path_of_the_flux();
  formats_agree_on_any_path_of_the_current();
  small_steps_accumulate_nothing();
  reversals_within_the_dead_band_change_no_state(0.8);
  reversals_within_the_dead_band_change_no_state(-0.8);
  damaged_numbers_stay_within_their_bounds();
  return verdict();
}
