/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/branch.h. */
#include "anhyst/law/branch.h"

#include "check.h"
#include "truth.h"

static anhyst_branch_f64 branch;
static anhyst_branch_slope_f64 slope;

static double place(uint64_t *seed)
{
  switch (random_bits(seed) % 3) {
  case 0:
    return uniform(seed, -31.0, 31.0);
  case 1:
    return log_uniform(seed, 29.0, ANHYST_X_MAX);
  default:
    return -log_uniform(seed, 29.0, ANHYST_X_MAX);
  }
}

static void table_agrees_with_quadrature(void)
{
  uint64_t seed = 1;
  double error = 0.0;
  double slope_error = 0.0;
  for (int set = 0; set < 120; set++) {
    const double kappa = set == 0   ? ANHYST_KAPPA_MIN
                         : set == 1 ? ANHYST_KAPPA_MAX
                                    : log_uniform(&seed, 1.001e-3, 0.999e3);
    CHECK(anhyst_branch_build_f64(&branch, kappa) == ANHYST_OK);
    CHECK(anhyst_branch_slope_build_f64(&slope, kappa) == ANHYST_OK);
    for (int i = 0; i < 60; i++) {
      const double x = place(&seed);
      const long double truth = true_branch((long double)kappa, (long double)x);
      const long double tilt = true_branch_slope((long double)kappa, (long double)x);
      keep_largest(&error, fabs((double)((long double)anhyst_branch_at_f64(&branch, x) - truth)));
      keep_largest(&slope_error,
                   kappa *
                       fabs((double)((long double)anhyst_branch_slope_at_f64(&slope, x) - tilt)));
    }
  }
  CHECK_BELOW("error of the branch", error, 4e-11);
  CHECK_BELOW("error of dA/dkappa times kappa", slope_error, 1e-9);
}

static void branch_stays_between_anhysteretic_and_saturation(void)
{
  const double kappas[] = {0.001, 0.05, 1.0, 30.0, 1000.0};
  for (int i = 0; i < 5; i++) {
    CHECK(anhyst_branch_build_f64(&branch, kappas[i]) == ANHYST_OK);
    double before = -1.0;
    for (int j = -4000; j <= 4000; j++) {
      const double x = j / 40.0;
      const double value = anhyst_branch_at_f64(&branch, x);
      CHECK(value >= before - 1e-11);
      CHECK((long double)value <= true_langevin((long double)x) + 4e-11L);
      before = value;
    }
  }
}

static void branch_is_constant_beyond_its_range(void)
{
  CHECK(anhyst_branch_build_f64(&branch, 1.0) == ANHYST_OK);
  const double far[] = {1e6, 1e30, (double)INFINITY};
  for (int i = 0; i < 3; i++) {
    CHECK_BELOW("A far right", fabs(anhyst_branch_at_f64(&branch, far[i]) - 1.0), 2e-5);
    CHECK_BELOW("A far left", fabs(anhyst_branch_at_f64(&branch, -far[i]) + 1.0), 2e-5);
  }
}

static void kappa_out_of_range_is_refused_and_nothing_is_written(void)
{
  const double bad[] = {0.0, -1.0, 0.9e-3, 1.1e3, (double)NAN, (double)INFINITY};
  for (int i = 0; i < 6; i++) {
    branch.kappa = 7.0;
    CHECK(anhyst_branch_build_f64(&branch, bad[i]) == ANHYST_BAD_PARAMETER);
    CHECK(anhyst_branch_slope_build_f64(&slope, bad[i]) == ANHYST_BAD_PARAMETER);
    CHECK(branch.kappa == 7.0);
  }
}

int main(void)
{
  table_agrees_with_quadrature();
  branch_stays_between_anhysteretic_and_saturation();
  branch_is_constant_beyond_its_range();
  kappa_out_of_range_is_refused_and_nothing_is_written();
  return verdict();
}
