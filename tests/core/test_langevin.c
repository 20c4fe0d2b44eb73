/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of anhyst/generic/langevin.h. */
#include "anhyst/langevin.h"

#include <float.h>

#include "check.h"
#include "format.h"
#include "truth.h"

static double value_error = 0.0;
static double slope_error = 0.0;

static double relative(real found, long double truth)
{
  return (double)fabsl(((long double)found - truth) / truth);
}

static void look(real z)
{
  real slope;
  const real value = ANHYST_NAME(anhyst_langevin)(z, &slope);
  keep_worst(&value_error, relative(value, true_langevin((long double)z)));
  keep_worst(&slope_error, relative(slope, true_langevin_slope((long double)z)));
}

static void langevin_is_right_to_rounding_at_any_argument(void)
{
  uint64_t seed = 1;
  const double largest = EITHER(1e150, 1e17);
  for (int i = 0; i < 300000; i++) {
    look((real)log_uniform(&seed, EITHER(1e-300, 1e-37), largest));
    look((real)uniform(&seed, -40.0, 40.0));
    look((real)uniform(&seed, 1.4, 1.6));
  }
  CHECK_BELOW("relative error of L", value_error, EITHER(4e-16, 2.5e-7));
  CHECK_BELOW("relative error of L'", slope_error, EITHER(1.7e-15, 1.1e-6));
}

static void langevin_is_odd_and_its_slope_even_at_zero_too(void)
{
  uint64_t seed = 2;
  real slope;
  real mirrored;
  CHECK(ANHYST_NAME(anhyst_langevin)(R(0.0), &slope) == R(0.0));
  CHECK_BELOW("slope at zero", fabs((double)slope - 1.0 / 3.0), EITHER(1e-16, 3e-8));
  for (int i = 0; i < 10000; i++) {
    const real z = (real)log_uniform(&seed, 1e-6, 1e3);
    const real value = ANHYST_NAME(anhyst_langevin)(z, &slope);
    CHECK(ANHYST_NAME(anhyst_langevin)(-z, &mirrored) == -value);
    CHECK(mirrored == slope);
  }
}

static void langevin_saturates_for_the_largest_numbers(void)
{
  const real huge[] = {EITHER(1e300, 1e37f), EITHER(DBL_MAX, FLT_MAX), (real)INFINITY};
  for (int i = 0; i < 3; i++) {
    real slope;
    CHECK(ANHYST_NAME(anhyst_langevin)(huge[i], &slope) == R(1.0));
    CHECK(slope >= R(0.0) && slope < R(1e-30));
    CHECK(ANHYST_NAME(anhyst_langevin)(-huge[i], &slope) == R(-1.0));
  }
}

static void inverse_is_as_good_as_its_condition_allows(void)
{
  uint64_t seed = 3;
  double error = 0.0;
  for (int i = 0; i < 20000; i++) {
    const real away = (real)log_uniform(&seed, EITHER(1e-12, 1e-4), 0.5);
    const real near = (real)log_uniform(&seed, EITHER(1e-200, 1e-30), 0.9);
    const real y[] = {R(1.0) - away, away - R(1.0), near, -near};
    for (int j = 0; j < 4; j++) {
      const real z = ANHYST_NAME(anhyst_inverse_langevin)(y[j]);
      const double distance = 1.0 - fabs((double)y[j]);
      keep_worst(&error, relative(z, true_inverse_langevin((long double)y[j])) * distance);
    }
  }
  CHECK_BELOW("relative error of the inverse times 1 - |y|", error, 4.0 * (double)ANHYST_EPS);
}

int main(void)
{
  langevin_is_right_to_rounding_at_any_argument();
  langevin_is_odd_and_its_slope_even_at_zero_too();
  langevin_saturates_for_the_largest_numbers();
  inverse_is_as_good_as_its_condition_allows();
  return verdict();
}
