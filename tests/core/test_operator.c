/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of anhyst/generic/operator.h. */
#include "check.h"
#include "laws.h"

static ANHYST_NAME(anhyst_branch) branch;

static ANHYST_NAME(anhyst_operator) make_law(uint64_t *seed, anhyst_step step, double kappa_low,
                                             double kappa_high)
{
  ANHYST_NAME(anhyst_operator) law = {step, R(0.0), R(0.0), R(0.0), R(0.0), &branch};
  law.kappa = (real)log_uniform(seed, kappa_low, kappa_high);
  law.c = (real)uniform(seed, 0.0, 1.0);
  if (step == ANHYST_STEP_EXACT) {
    CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, law.kappa) == ANHYST_OK);
  }
  CHECK(ANHYST_NAME(anhyst_operator_check)(&law) == ANHYST_OK);
  return law;
}

static ANHYST_NAME(anhyst_answer) go(const ANHYST_NAME(anhyst_operator) *law,
                                     const ANHYST_NAME(anhyst_state) *from, real x)
{
  ANHYST_NAME(anhyst_path) path;
  ANHYST_NAME(anhyst_answer) answer;
  ANHYST_NAME(anhyst_path_begin)(&path, law, from, x < from->x ? R(-1.0) : R(1.0), &answer);
  ANHYST_NAME(anhyst_path_at)(&path, x, &answer);
  return answer;
}

static double error_of_m(const ANHYST_NAME(anhyst_operator) *law,
                         const ANHYST_NAME(anhyst_answer) *answer, long double y)
{
  const long double c = (long double)law->c;
  const long double truth = (1.0L - c) * y + c * true_langevin((long double)answer->state.x);
  return fabs((double)((long double)answer->m - truth));
}

static void exact_step_agrees_with_the_integral(void)
{
  uint64_t seed = 11;
  double error = 0.0;
  for (int i = 0; i < 3000; i++) {
    const ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_EXACT, 1.01e-3, 990.0);
    const double spread = log_uniform(&seed, 0.1, 3e3);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, spread);
    const real x = (real)uniform(&seed, -spread, spread);
    const ANHYST_NAME(anhyst_answer) answer = go(&law, &from, x);
    const long double y = true_irreversible((long double)law.kappa, (long double)from.x,
                                            (long double)from.y, (long double)x);
    keep_worst(&error, error_of_m(&law, &answer, y));
  }
  CHECK_BELOW("error of m, exact step", error, EITHER(5e-11, 3e-6));
}

static void linear_step_is_within_its_bound(void)
{
  uint64_t seed = 12;
  double worst = 0.0;
  for (int i = 0; i < 3000; i++) {
    const ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_LINEAR, 1.01e-3, 990.0);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, 5.0);
    const double step = log_uniform(&seed, 1e-3, 3.0);
    const real x = from.x + (real)(random_bits(&seed) % 2 == 0 ? step : -step);
    const ANHYST_NAME(anhyst_answer) answer = go(&law, &from, x);
    const long double y = true_irreversible((long double)law.kappa, (long double)from.x,
                                            (long double)from.y, (long double)x);
    const double bound = 0.0133 * step * step + EITHER(1e-14, 1e-6);
    keep_worst(&worst, error_of_m(&law, &answer, y) / bound);
  }
  CHECK_BELOW("error of m over 0.0133*d^2, linear step", worst, 1.0);
}

static void law_of_1986_agrees_with_fine_steps(void)
{
  uint64_t seed = 13;
  double error = 0.0;
  for (int i = 0; i < 150; i++) {
    ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_JA1986, 0.05, 20.0);
    law.eps = (real)uniform(&seed, -5.0, 2.0);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, 6.0);
    const real x = (real)uniform(&seed, -6.0, 6.0);
    const ANHYST_NAME(anhyst_answer) answer = go(&law, &from, x);
    const long double y =
        true_irreversible_1986((long double)law.kappa, (long double)law.eps, (long double)from.x,
                               (long double)from.y, (long double)x);
    keep_worst(&error, error_of_m(&law, &answer, y));
  }
  CHECK_BELOW("error of m, law of 1986", error, EITHER(2e-6, 1e-5));
}

/* Its sub-steps must not be lost to rounding far out, nor be too many to wait for. */
static void law_of_1986_ends_at_any_distance(void)
{
  const real kappas[] = {R(1e-3), R(1e-2), R(1.0), R(1e3)};
  for (int i = 0; i < 4; i++) {
    const ANHYST_NAME(anhyst_operator) law = {
        ANHYST_STEP_JA1986, kappas[i], R(0.1), R(0.0), R(0.5), 0};
    const ANHYST_NAME(anhyst_state) from = {R(0.0), R(0.0), R(0.0)};
    for (int doublings = 0; doublings < 17; doublings++) {
      const double m = (double)go(&law, &from, (real)(1 << doublings)).m;
      CHECK(m > 0.0 && m < 1.0);
    }
  }
}

/* Slopes lie in their bounds and are the derivatives of what path_at returns. */
static void slopes_are_bounded_derivatives(anhyst_step step)
{
  uint64_t seed = 14 + (uint64_t)step;
  double excess = 0.0;
  double lack = 0.0;
  double error = 0.0;
  for (int i = 0; i < 4000; i++) {
    ANHYST_NAME(anhyst_operator) law = make_law(&seed, step, 0.02, 50.0);
    law.play = random_bits(&seed) % 2 == 0 ? R(0.0) : (real)uniform(&seed, 0.0, 1.0);
    law.eps = step == ANHYST_STEP_JA1986 ? (real)uniform(&seed, -5.0, 2.0) : R(0.0);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, 6.0);
    const real x = (real)uniform(&seed, -6.0, 6.0);
    const ANHYST_NAME(anhyst_answer) answer = go(&law, &from, x);
    const double steepest = (double)ANHYST_NAME(anhyst_operator_steepest)(&law);
    keep_worst(&excess, (double)answer.m_slope - steepest);
    keep_worst(&lack, -(double)answer.m_slope);
#ifndef TEST_f32
    const double h = 1e-5;
    if (fabs(x - from.x) > 2.0 * h) {
      const ANHYST_NAME(anhyst_answer) before = go(&law, &from, x - h);
      const ANHYST_NAME(anhyst_answer) after = go(&law, &from, x + h);
      const int smooth =
          (before.y_slope > 0.0) == (after.y_slope > 0.0) && step != ANHYST_STEP_JA1986;
      if (smooth) {
        keep_worst(&error, law.kappa * fabs((after.m - before.m) / (2.0 * h) - answer.m_slope));
      }
    }
#endif
  }
  CHECK_BELOW("dm/dx above its bound", excess, EITHER(1e-12, 1e-6));
  CHECK_BELOW("dm/dx below zero", lack, EITHER(0.0, 1e-6));
  CHECK_BELOW("dm/dx against differences, times kappa", error, 1e-6);
}

static void path_may_be_cut_anywhere(void)
{
  uint64_t seed = 15;
  double error = 0.0;
  for (int i = 0; i < 3000; i++) {
    ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_EXACT, 0.01, 100.0);
    law.play = random_bits(&seed) % 2 == 0 ? R(0.0) : (real)uniform(&seed, 0.0, 1.0);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, 6.0);
    const real end = (real)uniform(&seed, -6.0, 6.0);
    const real middle = from.x + (end - from.x) * (real)uniform(&seed, 0.0, 1.0);
    const ANHYST_NAME(anhyst_answer) half = go(&law, &from, middle);
    const ANHYST_NAME(anhyst_answer) cut = go(&law, &half.state, end);
    const ANHYST_NAME(anhyst_answer) whole = go(&law, &from, end);
    keep_worst(&error, fabs((double)(cut.m - whole.m)));
  }
  CHECK_BELOW("a path cut in two", error, EITHER(1e-10, 4e-6));
}

static void law_is_odd_to_the_last_bit(anhyst_step step)
{
  uint64_t seed = 16;
  for (int i = 0; i < 500; i++) {
    ANHYST_NAME(anhyst_operator) law = make_law(&seed, step, 0.05, 20.0);
    law.play = random_bits(&seed) % 2 == 0 ? R(0.0) : (real)uniform(&seed, 0.0, 1.0);
    const ANHYST_NAME(anhyst_state) from = wander(&seed, &law, 6.0);
    const ANHYST_NAME(anhyst_state) mirrored = {-from.x, -from.y, -from.p};
    const real x = (real)uniform(&seed, -6.0, 6.0);
    CHECK(go(&law, &mirrored, -x).m == -go(&law, &from, x).m);
  }
}

static void only_states_the_law_can_reach_are_accepted(void)
{
  uint64_t seed = 17;
  for (int i = 0; i < 2000; i++) {
    ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_EXACT, 0.01, 100.0);
    law.play = random_bits(&seed) % 2 == 0 ? R(0.0) : (real)uniform(&seed, 0.1, 1.0);
    const ANHYST_NAME(anhyst_state) good = wander(&seed, &law, 50.0);
    CHECK(ANHYST_NAME(anhyst_state_check)(&law, &good) == ANHYST_OK);
    ANHYST_NAME(anhyst_state) bad = good;
    bad.x = good.p + law.play + R(0.1);
    CHECK(ANHYST_NAME(anhyst_state_check)(&law, &bad) == ANHYST_BAD_STATE);
    bad = good;
    bad.y += R(2.0) * law.kappa / R(3.0) + R(1e-3);
    CHECK(ANHYST_NAME(anhyst_state_check)(&law, &bad) == ANHYST_BAD_STATE);
  }
  const ANHYST_NAME(anhyst_operator) law = make_law(&seed, ANHYST_STEP_EXACT, 10.0, 10.1);
  const real nan = (real)NAN;
  const ANHYST_NAME(anhyst_state) bad[] = {
      {nan, R(0.0), R(0.0)},
      {R(0.0), nan, R(0.0)},
      {R(0.0), R(0.0), nan},
      {R(0.0), R(1.0), R(0.0)},
      {R(0.0), R(-1.0), R(0.0)},
      {R(9e4), R(0.99), R(9e4)},
      {(real)INFINITY, R(0.0), R(0.0)},
      {(real)INFINITY, R(0.5), (real)INFINITY},
  };
  for (int i = 0; i < 8; i++) {
    CHECK(ANHYST_NAME(anhyst_state_check)(&law, &bad[i]) == ANHYST_BAD_STATE);
  }
}

static void parameters_out_of_range_are_refused(void)
{
  CHECK(ANHYST_NAME(anhyst_branch_build)(&branch, R(1.0)) == ANHYST_OK);
  const real nan = (real)NAN;
  const real inf = (real)INFINITY;
  const ANHYST_NAME(anhyst_operator) bad[] = {
      {ANHYST_STEP_LINEAR, R(0.0), R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(-1.0), R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(2e3), R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, nan, R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, inf, R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), R(-0.01), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), R(1.01), R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), nan, R(0.0), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), R(0.1), R(-0.1), R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), R(0.1), nan, R(0.0), 0},
      {ANHYST_STEP_LINEAR, R(1.0), R(0.1), inf, R(0.0), 0},
      {ANHYST_STEP_JA1986, R(1.0), R(0.1), R(0.0), R(3.0), 0},
      {ANHYST_STEP_JA1986, R(1.0), R(0.1), R(0.0), nan, 0},
      {ANHYST_STEP_JA1986, R(1.0), R(0.1), R(0.0), -inf, 0},
      {ANHYST_STEP_EXACT, R(1.0), R(0.1), R(0.0), R(0.0), 0},
      {ANHYST_STEP_EXACT, R(1.5), R(0.1), R(0.0), R(0.0), &branch},
  };
  for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    CHECK(ANHYST_NAME(anhyst_operator_check)(&bad[i]) == ANHYST_BAD_PARAMETER);
  }
}

int main(void)
{
  exact_step_agrees_with_the_integral();
  linear_step_is_within_its_bound();
  law_of_1986_agrees_with_fine_steps();
  law_of_1986_ends_at_any_distance();
  slopes_are_bounded_derivatives(ANHYST_STEP_EXACT);
  slopes_are_bounded_derivatives(ANHYST_STEP_LINEAR);
  slopes_are_bounded_derivatives(ANHYST_STEP_JA1986);
  path_may_be_cut_anywhere();
  law_is_odd_to_the_last_bit(ANHYST_STEP_EXACT);
  law_is_odd_to_the_last_bit(ANHYST_STEP_LINEAR);
  law_is_odd_to_the_last_bit(ANHYST_STEP_JA1986);
  only_states_the_law_can_reach_are_accepted();
  parameters_out_of_range_are_refused();
  return verdict();
}
