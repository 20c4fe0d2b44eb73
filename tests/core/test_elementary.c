/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/numeric/elementary.h. */
#include "anhyst/numeric/elementary.h"

#include <float.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "truth.h"

#define DRAWS 200000

/* Returns the error in units of the last place of the true value. */
static double units(double found, long double truth)
{
  int exponent;
  (void)frexpl(truth, &exponent);
  const int place = exponent - DBL_MANT_DIG;
  return (double)(fabsl((long double)found - truth) / ldexpl(1.0L, place > -1074 ? place : -1074));
}

static void exp_error_is_below_0_6_ulp(void)
{
  uint64_t seed = 71;
  double normal = 0.0;
  double tiny = 0.0;
  for (int i = 0; i < DRAWS; i++) {
    const double wide = uniform(&seed, -708.0, 709.7);
    const double near = (i % 2 ? 1.0 : -1.0) * log_uniform(&seed, 1e-20, 40.0);
    const double low = uniform(&seed, -745.0, -708.0);
    keep_largest(&normal, units(anhyst_exp_f64(wide), expl((long double)wide)));
    keep_largest(&normal, units(anhyst_exp_f64(near), expl((long double)near)));
    keep_largest(&tiny, units(anhyst_exp_f64(low), expl((long double)low)));
  }
  CHECK_BELOW("exp", normal, 0.6);
  CHECK_BELOW("exp below the normal numbers", tiny, 0.8);
}

static void log_error_is_below_1_1_ulp(void)
{
  uint64_t seed = 72;
  double wide = 0.0;
  double near_one = 0.0;
  for (int i = 0; i < DRAWS; i++) {
    const double x = log_uniform(&seed, 1e-307, 1e307) * (i % 8 ? 1.0 : 1e-10);
    const double near = 1.0 + (i % 2 ? 1.0 : -1.0) * log_uniform(&seed, 1e-15, 0.5);
    keep_largest(&wide, units(anhyst_log_f64(x), logl((long double)x)));
    keep_largest(&near_one, units(anhyst_log_f64(near), logl((long double)near)));
  }
  CHECK_BELOW("log", wide, 1.1);
  CHECK_BELOW("log about 1", near_one, 1.1);
}

static void atan_error_is_below_0_7_ulp(void)
{
  uint64_t seed = 73;
  double worst = 0.0;
  for (int i = 0; i < DRAWS; i++) {
    const double sign = i % 2 ? 1.0 : -1.0;
    const double wide = sign * log_uniform(&seed, 1e-300, 1e300);
    const double near = sign * log_uniform(&seed, 1e-2, 1e2);
    keep_largest(&worst, units(anhyst_atan_f64(wide), atanl((long double)wide)));
    keep_largest(&worst, units(anhyst_atan_f64(near), atanl((long double)near)));
  }
  CHECK_BELOW("atan", worst, 0.7);
}

/* Arguments at the ends of table entries, of octaves and of the range. */
static void errors_are_small_at_interval_ends(void)
{
  double exp_worst = 0.0;
  double log_worst = 0.0;
  double atan_worst = 0.0;
  for (int i = -6000; i <= 6000; i++) {
    for (int side = -1; side <= 1; side++) {
      const double aside = 1.0 + (double)side * DBL_EPSILON;
      const double step = ((double)i + 0.5) * 0.010830424696249145 * aside; /* log(2)/64 */
      const double grid = (1.0 + (double)(i + 6000) / 128.0) * aside;
      const double octave = ldexp(1.0 + (double)((i + 6000) % 8) / 8.0, i / 60) * aside;
      keep_largest(&exp_worst, units(anhyst_exp_f64(step), expl((long double)step)));
      keep_largest(&log_worst, units(anhyst_log_f64(grid), logl((long double)grid)));
      keep_largest(&log_worst, units(anhyst_log_f64(1.0 / grid), logl((long double)(1.0 / grid))));
      keep_largest(&atan_worst, units(anhyst_atan_f64(octave), atanl((long double)octave)));
    }
  }
  CHECK_BELOW("exp at the seams", exp_worst, 0.6);
  CHECK_BELOW("log at the seams", log_worst, 1.1);
  CHECK_BELOW("atan at the seams", atan_worst, 0.7);
}

static int same(double a, double b) { return memcmp(&a, &b, sizeof a) == 0; }

static void limits_are_those_of_the_c_library(void)
{
  CHECK(same(anhyst_exp_f64(0.0), 1.0) && same(anhyst_exp_f64(-0.0), 1.0));
  CHECK(same(anhyst_exp_f64(-HUGE_VAL), 0.0) && same(anhyst_exp_f64(-800.0), 0.0));
  CHECK(isinf(anhyst_exp_f64(HUGE_VAL)) && isinf(anhyst_exp_f64(709.8)));
  CHECK(isfinite(anhyst_exp_f64(709.78)) && anhyst_exp_f64(-745.1) > 0.0);
  CHECK(isnan(anhyst_exp_f64((double)NAN)));
  CHECK(same(anhyst_log_f64(1.0), 0.0) && isnan(anhyst_log_f64(-1.0)));
  CHECK(same(anhyst_log_f64(0.0), -HUGE_VAL) && same(anhyst_log_f64(-0.0), -HUGE_VAL));
  CHECK(same(anhyst_log_f64(HUGE_VAL), HUGE_VAL) && isnan(anhyst_log_f64((double)NAN)));
  CHECK(same(anhyst_atan_f64(0.0), 0.0) && same(anhyst_atan_f64(-0.0), -0.0));
  CHECK(same(anhyst_atan_f64(HUGE_VAL), 1.5707963267948966));
  CHECK(same(anhyst_atan_f64(-HUGE_VAL), -1.5707963267948966));
  CHECK(isnan(anhyst_atan_f64((double)NAN)));
}

/* FNV-1a over the bytes of a number, the lowest first. */
static void hash_number(uint64_t *hash, double value)
{
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  for (int i = 0; i < 8; i++) {
    *hash = (*hash ^ ((bits >> (8 * i)) & 0xFFU)) * UINT64_C(0x100000001B3);
  }
}

static void results_are_bit_identical_on_all_machines(void)
{
  uint64_t seed = 74;
  uint64_t hash = UINT64_C(0xCBF29CE484222325);
  for (int i = 0; i < DRAWS; i++) {
    const double x = uniform(&seed, -40.0, 40.0);
    hash_number(&hash, anhyst_exp_f64(x));
    hash_number(&hash, anhyst_log_f64(x * x));
    hash_number(&hash, anhyst_atan_f64(x));
  }
  CHECK(hash == UINT64_C(0x69302D34498DA0AE));
}

int main(void)
{
  exp_error_is_below_0_6_ulp();
  log_error_is_below_1_1_ulp();
  atan_error_is_below_0_7_ulp();
  errors_are_small_at_interval_ends();
  limits_are_those_of_the_c_library();
  results_are_bit_identical_on_all_machines();
  return verdict();
}
