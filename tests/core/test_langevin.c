/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/langevin.h. */
#include "anhyst/law/langevin.h"

#include <float.h>

#include "check.h"
#include "truth.h"

static double value_error = 0.0;
static double slope_error = 0.0;

static double relative_error(double found, long double truth)
{
  return (double)fabsl(((long double)found - truth) / truth);
}

static void compare_at(double z)
{
  double slope;
  const double value = anhyst_langevin_f64(z, &slope);
  keep_largest(&value_error, relative_error(value, true_langevin((long double)z)));
  keep_largest(&slope_error, relative_error(slope, true_langevin_slope((long double)z)));
}

static void langevin_error_is_rounding_at_any_argument(void)
{
  uint64_t seed = 1;
  const double largest = 1e150;
  for (int i = 0; i < 300000; i++) {
    compare_at(log_uniform(&seed, 1e-300, largest));
    compare_at(uniform(&seed, -40.0, 40.0));
    compare_at(uniform(&seed, 1.4, 1.6));
  }
  CHECK_BELOW("relative error of L", value_error, 4e-16);
  CHECK_BELOW("relative error of L'", slope_error, 1.7e-15);
}

static void langevin_is_odd_and_its_slope_is_even(void)
{
  uint64_t seed = 2;
  double slope;
  double mirrored;
  CHECK(anhyst_langevin_f64(0.0, &slope) == 0.0);
  CHECK_BELOW("slope at zero", fabs(slope - 1.0 / 3.0), 1e-16);
  for (int i = 0; i < 10000; i++) {
    const double z = log_uniform(&seed, 1e-6, 1e3);
    const double value = anhyst_langevin_f64(z, &slope);
    CHECK(anhyst_langevin_f64(-z, &mirrored) == -value);
    CHECK(mirrored == slope);
  }
}

static void langevin_saturates_for_the_largest_numbers(void)
{
  const double huge[] = {1e300, DBL_MAX, (double)INFINITY};
  for (int i = 0; i < 3; i++) {
    double slope;
    CHECK(anhyst_langevin_f64(huge[i], &slope) == 1.0);
    CHECK(slope >= 0.0 && slope < 1e-30);
    CHECK(anhyst_langevin_f64(-huge[i], &slope) == -1.0);
  }
}

static void inverse_error_matches_its_condition(void)
{
  uint64_t seed = 3;
  double error = 0.0;
  for (int i = 0; i < 20000; i++) {
    const double away = log_uniform(&seed, 1e-12, 0.5);
    const double near = log_uniform(&seed, 1e-200, 0.9);
    const double y[] = {1.0 - away, away - 1.0, near, -near};
    for (int j = 0; j < 4; j++) {
      const double z = anhyst_inverse_langevin_f64(y[j]);
      const double distance = 1.0 - fabs(y[j]);
      keep_largest(&error, relative_error(z, true_inverse_langevin((long double)y[j])) * distance);
    }
  }
  CHECK_BELOW("relative error of the inverse times 1 - |y|", error, 4.0 * DBL_EPSILON);
}

int main(void)
{
  langevin_error_is_rounding_at_any_argument();
  langevin_is_odd_and_its_slope_is_even();
  langevin_saturates_for_the_largest_numbers();
  inverse_error_matches_its_condition();
  return verdict();
}
