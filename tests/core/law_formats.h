/* SPDX-License-Identifier: Apache-2.0 */
/* A law in fixed point, f32 and f64 on the same path. The including file defines before:
   LAW_FORMATS, one FORMAT(...) for each, with the words of the law. */
#ifndef TEST_LAW_FORMATS_H
#define TEST_LAW_FORMATS_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/compensator/compensator_f32.h"
#include "anhyst/compensator/compensator_f64.h"

#include <string.h>

#include "check.h"
#include "truth.h"

/* The coefficients (weights) of the current at the gap of the tick. */
static int flux_arm = 12000;
static int field_arm = 16000;

/* A compensator of each format, with steps in fractions of full scale. */
#define FORMAT(name, type, arms_type, kernel_of_law, number, words_of_law, one, weight)            \
  static type name;                                                                                \
  static void name##_start(void)                                                                   \
  {                                                                                                \
    const type none = {.kernel = &kernel_of_law, .words = words_of_law};                           \
    name = none;                                                                                   \
    if (name.kernel->for_block != 0) {                                                             \
      name.kernel = name.kernel->for_block(name.words);                                            \
    }                                                                                              \
    if (name.kernel->start != 0) {                                                                 \
      name.kernel->start(&name);                                                                   \
    }                                                                                              \
  }                                                                                                \
  static double name##_field(double flux)                                                          \
  {                                                                                                \
    const arms_type arms = {0, weight(flux_arm), weight(field_arm)};                               \
    name.arms = arms;                                                                              \
    name.flux = (number)(flux * (one));                                                            \
    name.stage = name.stage == ANHYST_STAGE_HERE ? ANHYST_STAGE_HERE : ANHYST_STAGE_UNKNOWN;       \
    const number x = name.kernel->field(&name);                                                    \
    name.stage = ANHYST_STAGE_AHEAD;                                                               \
    name.flux_applied = name.flux;                                                                 \
    return (double)x / (one);                                                                      \
  }                                                                                                \
  static double name##_flux(double current)                                                        \
  {                                                                                                \
    name.flux_applied = name.kernel->flux(&name, (number)(current * (one)));                       \
    return (double)name.flux_applied / (one);                                                      \
  }                                                                                                \
  static void name##_keep(void)                                                                    \
  {                                                                                                \
    if (name.kernel->keep != 0) {                                                                  \
      name.kernel->keep(&name);                                                                    \
    }                                                                                              \
    name.memory = name.next.memory;                                                                \
    name.stage = ANHYST_STAGE_HERE;                                                                \
  }

static int16_t weight_of(int arm) { return (int16_t)arm; }
static float single_of(int arm) { return (float)arm / 65536.0F; }
static double double_of(int arm) { return arm / 65536.0; }

LAW_FORMATS

/* The numbers of a random path are multiples of 2^-20: the same in every format. */
static double rounded(double a) { return floor(a * 1048576.0) / 1048576.0; }

/* Returns the next flux of a random path: steps of any size, down to noise, and jumps over the
   range. */
static inline double next_flux(double flux, double most, uint64_t *seed)
{
  const int shift = (int)(random_bits(seed) % 18U);
  const double step = uniform(seed, -1.0, 1.0) / (double)(1L << shift);
  return rounded(fmin(fmax(flux + step, -most), most));
}

typedef struct {
  void (*start)(void);
  double (*field)(double flux);
  double (*flux)(double current);
  void (*keep)(void);
  const char *name;
} format;

static const format FORMATS[3] = {{fixed_start, fixed_field, fixed_flux, fixed_keep, "fixed point"},
                                  {f32_start, f32_field, f32_flux, f32_keep, "f32"},
                                  {f64_start, f64_field, f64_flux, f64_keep, "f64"}};

/* Solves for a flux, and applies the current, rounded to a converter's grid if there is one.
   Returns the solved current. */
static inline double tick(const format *law, double flux, int has_converter)
{
  const double x = law->field(flux);
  const double current = double_of(flux_arm) * flux + double_of(field_arm) * x;
  if (has_converter) {
    (void)law->flux(floor(current * 4096.0 + 0.5) / 4096.0);
  }
  law->keep();
  return current;
}

/* Moves the iron to a demand on an ascending branch, or on a descending one from above. */
static inline void approach_demand(const format *law, double flux, int descends)
{
  law->start();
  for (int i = 0; i <= 1000; i++) {
    const double top = descends ? 0.7 : flux;
    (void)tick(law, i < 700 ? top * i / 700.0 : top + (flux - top) * (i - 700) / 300.0, 0);
  }
}

/* Damages one word of the state. */
static inline void damage_word(void *state, size_t size, uint64_t *seed)
{
  static const uint32_t PATTERNS[8] = {0x7FC00000U, 0x7F800000U, 0xFF800000U, 0x7FFFFFFFU,
                                       0x80000000U, 0xFFFFFFFFU, 0x4B000000U, 0xFFF00000U};
  const uint64_t choice = random_bits(seed);
  const uint32_t word =
      choice % 3U == 0U ? (uint32_t)random_bits(seed) : PATTERNS[choice / 3U % 8U];
  const size_t at = (size_t)(random_bits(seed) % (size / 4U)) * 4U;
  memcpy((char *)state + at, &word, 4);
}

#endif
