/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/operator.h. */
#include "check.h"
#include "laws.h"

static anhyst_branch_f64 branch;

static anhyst_operator_f64 make_law(uint64_t *seed, anhyst_step step, double kappa_low,
                                    double kappa_high)
{
  anhyst_operator_f64 law = {step, 0.0, 0.0, 0.0, 0.0, &branch};
  law.kappa = log_uniform(seed, kappa_low, kappa_high);
  law.c = uniform(seed, 0.0, 1.0);
  if (step == ANHYST_STEP_EXACT) {
    CHECK(anhyst_branch_build_f64(&branch, law.kappa) == ANHYST_OK);
  }
  CHECK(anhyst_operator_check_f64(&law) == ANHYST_OK);
  return law;
}

static anhyst_answer_f64 follow_path(const anhyst_operator_f64 *law, const anhyst_state_f64 *from,
                                     double x)
{
  anhyst_path_f64 path;
  anhyst_answer_f64 answer;
  anhyst_path_begin_f64(&path, law, from, x < from->x ? -1.0 : 1.0, &answer);
  anhyst_path_at_f64(&path, x, &answer);
  return answer;
}

static double error_of_m(const anhyst_operator_f64 *law, const anhyst_answer_f64 *answer,
                         long double y)
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
    const anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_EXACT, 1.01e-3, 990.0);
    const double spread = log_uniform(&seed, 0.1, 3e3);
    const anhyst_state_f64 from = random_state(&seed, &law, spread);
    const double x = uniform(&seed, -spread, spread);
    const anhyst_answer_f64 answer = follow_path(&law, &from, x);
    const long double y = true_irreversible((long double)law.kappa, (long double)from.x,
                                            (long double)from.y, (long double)x);
    keep_largest(&error, error_of_m(&law, &answer, y));
  }
  CHECK_BELOW("error of m, exact step", error, 5e-11);
}

static void linear_step_error_is_within_its_bound(void)
{
  uint64_t seed = 12;
  double worst = 0.0;
  for (int i = 0; i < 3000; i++) {
    const anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_LINEAR, 1.01e-3, 990.0);
    const anhyst_state_f64 from = random_state(&seed, &law, 5.0);
    const double step = log_uniform(&seed, 1e-3, 3.0);
    const double x = from.x + (random_bits(&seed) % 2 == 0 ? step : -step);
    const anhyst_answer_f64 answer = follow_path(&law, &from, x);
    const long double y = true_irreversible((long double)law.kappa, (long double)from.x,
                                            (long double)from.y, (long double)x);
    const double bound = 0.0133 * step * step + 1e-14;
    keep_largest(&worst, error_of_m(&law, &answer, y) / bound);
  }
  CHECK_BELOW("error of m over 0.0133*d^2, linear step", worst, 1.0);
}

static void law_of_1986_agrees_with_fine_steps(void)
{
  uint64_t seed = 13;
  double error = 0.0;
  for (int i = 0; i < 150; i++) {
    anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_JA1986, 0.05, 20.0);
    law.eps = uniform(&seed, -5.0, 2.0);
    const anhyst_state_f64 from = random_state(&seed, &law, 6.0);
    const double x = uniform(&seed, -6.0, 6.0);
    const anhyst_answer_f64 answer = follow_path(&law, &from, x);
    const long double y =
        true_irreversible_1986((long double)law.kappa, (long double)law.eps, (long double)from.x,
                               (long double)from.y, (long double)x);
    keep_largest(&error, error_of_m(&law, &answer, y));
  }
  CHECK_BELOW("error of m, law of 1986", error, 2e-6);
}

/* At large fields, sub-steps must not be lost to rounding, and their number must stay
   acceptable. */
static void law_of_1986_terminates_at_any_distance(void)
{
  const double kappas[] = {1e-3, 1e-2, 1.0, 1e3};
  for (int i = 0; i < 4; i++) {
    const anhyst_operator_f64 law = {ANHYST_STEP_JA1986, kappas[i], 0.1, 0.0, 0.5, 0};
    const anhyst_state_f64 from = {0.0, 0.0, 0.0};
    for (int doublings = 0; doublings < 17; doublings++) {
      const double m = follow_path(&law, &from, (1 << doublings)).m;
      CHECK(m > 0.0 && m < 1.0);
    }
  }
}

/* Slopes are within their bounds, and are the derivatives of the results of path_at. */
static void slopes_are_bounded_derivatives(anhyst_step step)
{
  uint64_t seed = 14 + (uint64_t)step;
  double excess = 0.0;
  double lack = 0.0;
  double error = 0.0;
  for (int i = 0; i < 4000; i++) {
    anhyst_operator_f64 law = make_law(&seed, step, 0.02, 50.0);
    law.play = random_bits(&seed) % 2 == 0 ? 0.0 : uniform(&seed, 0.0, 1.0);
    law.eps = step == ANHYST_STEP_JA1986 ? uniform(&seed, -5.0, 2.0) : 0.0;
    const anhyst_state_f64 from = random_state(&seed, &law, 6.0);
    const double x = uniform(&seed, -6.0, 6.0);
    const anhyst_answer_f64 answer = follow_path(&law, &from, x);
    const double steepest_slope = anhyst_operator_steepest_f64(&law);
    keep_largest(&excess, answer.m_slope - steepest_slope);
    keep_largest(&lack, -answer.m_slope);
    const double h = 1e-5;
    if (fabs(x - from.x) > 2.0 * h) {
      const anhyst_answer_f64 before = follow_path(&law, &from, x - h);
      const anhyst_answer_f64 after = follow_path(&law, &from, x + h);
      const int smooth =
          (before.y_slope > 0.0) == (after.y_slope > 0.0) && step != ANHYST_STEP_JA1986;
      if (smooth) {
        keep_largest(&error, law.kappa * fabs((after.m - before.m) / (2.0 * h) - answer.m_slope));
      }
    }
  }
  CHECK_BELOW("dm/dx above its bound", excess, 1e-12);
  CHECK_BELOW("dm/dx below zero", lack, 0.0);
  CHECK_BELOW("dm/dx against differences, times kappa", error, 1e-6);
}

static void path_can_be_divided_anywhere(void)
{
  uint64_t seed = 15;
  double error = 0.0;
  for (int i = 0; i < 3000; i++) {
    anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_EXACT, 0.01, 100.0);
    law.play = random_bits(&seed) % 2 == 0 ? 0.0 : uniform(&seed, 0.0, 1.0);
    const anhyst_state_f64 from = random_state(&seed, &law, 6.0);
    const double end = uniform(&seed, -6.0, 6.0);
    const double middle = from.x + (end - from.x) * uniform(&seed, 0.0, 1.0);
    const anhyst_answer_f64 half = follow_path(&law, &from, middle);
    const anhyst_answer_f64 cut = follow_path(&law, &half.state, end);
    const anhyst_answer_f64 whole = follow_path(&law, &from, end);
    keep_largest(&error, fabs(cut.m - whole.m));
  }
  CHECK_BELOW("a path cut in two", error, 1e-10);
}

static void law_is_odd_to_the_last_bit(anhyst_step step)
{
  uint64_t seed = 16;
  for (int i = 0; i < 500; i++) {
    anhyst_operator_f64 law = make_law(&seed, step, 0.05, 20.0);
    law.play = random_bits(&seed) % 2 == 0 ? 0.0 : uniform(&seed, 0.0, 1.0);
    const anhyst_state_f64 from = random_state(&seed, &law, 6.0);
    const anhyst_state_f64 mirrored = {-from.x, -from.y, -from.p};
    const double x = uniform(&seed, -6.0, 6.0);
    CHECK(follow_path(&law, &mirrored, -x).m == -follow_path(&law, &from, x).m);
  }
}

static void only_reachable_states_are_accepted(void)
{
  uint64_t seed = 17;
  for (int i = 0; i < 2000; i++) {
    anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_EXACT, 0.01, 100.0);
    law.play = random_bits(&seed) % 2 == 0 ? 0.0 : uniform(&seed, 0.1, 1.0);
    const anhyst_state_f64 good = random_state(&seed, &law, 50.0);
    CHECK(anhyst_state_check_f64(&law, &good) == ANHYST_OK);
    anhyst_state_f64 bad = good;
    bad.x = good.p + law.play + 0.1;
    CHECK(anhyst_state_check_f64(&law, &bad) == ANHYST_BAD_STATE);
    bad = good;
    bad.y += 2.0 * law.kappa / 3.0 + 1e-3;
    CHECK(anhyst_state_check_f64(&law, &bad) == ANHYST_BAD_STATE);
  }
  const anhyst_operator_f64 law = make_law(&seed, ANHYST_STEP_EXACT, 10.0, 10.1);
  const double nan = (double)NAN;
  const anhyst_state_f64 bad[] = {
      {nan, 0.0, 0.0},
      {0.0, nan, 0.0},
      {0.0, 0.0, nan},
      {0.0, 1.0, 0.0},
      {0.0, -1.0, 0.0},
      {9e4, 0.99, 9e4},
      {(double)INFINITY, 0.0, 0.0},
      {(double)INFINITY, 0.5, (double)INFINITY},
  };
  for (int i = 0; i < 8; i++) {
    CHECK(anhyst_state_check_f64(&law, &bad[i]) == ANHYST_BAD_STATE);
  }
}

static void parameters_out_of_range_are_refused(void)
{
  CHECK(anhyst_branch_build_f64(&branch, 1.0) == ANHYST_OK);
  const double nan = (double)NAN;
  const double inf = (double)INFINITY;
  const anhyst_operator_f64 bad[] = {
      {ANHYST_STEP_LINEAR, 0.0, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, -1.0, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, 2e3, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, nan, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, inf, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, -0.01, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, 1.01, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, nan, 0.0, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, 0.1, -0.1, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, 0.1, nan, 0.0, 0},
      {ANHYST_STEP_LINEAR, 1.0, 0.1, inf, 0.0, 0},
      {ANHYST_STEP_JA1986, 1.0, 0.1, 0.0, 3.0, 0},
      {ANHYST_STEP_JA1986, 1.0, 0.1, 0.0, nan, 0},
      {ANHYST_STEP_JA1986, 1.0, 0.1, 0.0, -inf, 0},
      {ANHYST_STEP_EXACT, 1.0, 0.1, 0.0, 0.0, 0},
      {ANHYST_STEP_EXACT, 1.5, 0.1, 0.0, 0.0, &branch},
  };
  for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++) {
    CHECK(anhyst_operator_check_f64(&bad[i]) == ANHYST_BAD_PARAMETER);
  }
}

int main(void)
{
  exact_step_agrees_with_the_integral();
  linear_step_error_is_within_its_bound();
  law_of_1986_agrees_with_fine_steps();
  law_of_1986_terminates_at_any_distance();
  slopes_are_bounded_derivatives(ANHYST_STEP_EXACT);
  slopes_are_bounded_derivatives(ANHYST_STEP_LINEAR);
  slopes_are_bounded_derivatives(ANHYST_STEP_JA1986);
  path_can_be_divided_anywhere();
  law_is_odd_to_the_last_bit(ANHYST_STEP_EXACT);
  law_is_odd_to_the_last_bit(ANHYST_STEP_LINEAR);
  law_is_odd_to_the_last_bit(ANHYST_STEP_JA1986);
  only_reachable_states_are_accepted();
  parameters_out_of_range_are_refused();
  return verdict();
}
