/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of anhyst/generic/branch.h. */
#include "anhyst/branch.h"

#include "check.h"
#include "format.h"
#include "truth.h"

static ANHYST_NAME(anhyst_branch) branch;
static ANHYST_NAME(anhyst_branch_slope) slope;

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
    const real kappa = set == 0   ? (real)ANHYST_KAPPA_MIN
                       : set == 1 ? (real)ANHYST_KAPPA_MAX
                                  : (real)log_uniform(&seed, 1.001e-3, 0.999e3);
    CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, kappa) == ANHYST_OK);
    CHECK(ANHYST_NAME(anhyst_branch_slope_build)(&slope, kappa) == ANHYST_OK);
    for (int i = 0; i < 60; i++) {
      const real x = (real)place(&seed);
      const long double truth = true_branch((long double)kappa, (long double)x);
      const long double tilt = true_branch_slope((long double)kappa, (long double)x);
      keep_worst(&error,
                 fabs((double)((long double)ANHYST_NAME(anhyst_branch_at)(&branch, x) - truth)));
      keep_worst(
          &slope_error,
          (double)kappa *
              fabs((double)((long double)ANHYST_NAME(anhyst_branch_slope_at)(&slope, x) - tilt)));
    }
  }
  CHECK_BELOW("error of the branch", error, EITHER(4e-11, 2e-6));
  CHECK_BELOW("error of dA/dkappa times kappa", slope_error, EITHER(1e-9, 2e-5));
}

static void branch_stays_between_anhysteretic_and_saturation(void)
{
  const real kappas[] = {R(0.001), R(0.05), R(1.0), R(30.0), R(1000.0)};
  for (int i = 0; i < 5; i++) {
    CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, kappas[i]) == ANHYST_OK);
    real before = R(-1.0);
    for (int j = -4000; j <= 4000; j++) {
      const real x = (real)j / R(40.0);
      const real value = ANHYST_NAME(anhyst_branch_at)(&branch, x);
      CHECK(value >= before - EITHER(1e-11, 2e-6f));
      CHECK((long double)value <= true_langevin((long double)x) + EITHER(4e-11L, 2e-6L));
      before = value;
    }
  }
}

static void branch_is_continued_flat_beyond_its_range(void)
{
  CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, R(1.0)) == ANHYST_OK);
  const real far[] = {R(1e6), R(1e30), (real)INFINITY};
  for (int i = 0; i < 3; i++) {
    CHECK_BELOW("A far right", fabs((double)ANHYST_NAME(anhyst_branch_at)(&branch, far[i]) - 1.0),
                2e-5);
    CHECK_BELOW("A far left", fabs((double)ANHYST_NAME(anhyst_branch_at)(&branch, -far[i]) + 1.0),
                2e-5);
  }
}

static void kappa_out_of_range_is_refused_and_nothing_is_written(void)
{
  const real bad[] = {R(0.0), R(-1.0), R(0.9e-3), R(1.1e3), (real)NAN, (real)INFINITY};
  for (int i = 0; i < 6; i++) {
    branch.kappa = R(7.0);
    CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, bad[i]) == ANHYST_BAD_PARAMETER);
    CHECK(ANHYST_NAME(anhyst_branch_slope_build)(&slope, bad[i]) == ANHYST_BAD_PARAMETER);
    CHECK(branch.kappa == R(7.0));
  }
}

int main(void)
{
  table_agrees_with_quadrature();
  branch_stays_between_anhysteretic_and_saturation();
  branch_is_continued_flat_beyond_its_range();
  kappa_out_of_range_is_refused_and_nothing_is_written();
  return verdict();
}
