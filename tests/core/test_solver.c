/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/solver.h. */
#include <float.h>
#include <string.h>

#include "check.h"
#include "laws.h"

static anhyst_branch_f64 branch;
static int branches_drawn = 0;

typedef struct {
  anhyst_operator_f64 law;
  anhyst_state_f64 from;
  double omega, r;
} problem;

/* Returns a random problem. low and high limit 1 + omega*A, where A is the steepest slope of the
   law. The sum is below zero if the magnetisation jumps. */
static problem random_problem(uint64_t *seed, anhyst_step step, double low, double high,
                              double reach)
{
  problem p;
  p.law.step = step;
  p.law.kappa = log_uniform(seed, step == ANHYST_STEP_JA1986 ? 0.1 : 1.01e-3, 990.0);
  p.law.c = uniform(seed, 0.0, 1.0);
  p.law.play = random_bits(seed) % 2 == 0 ? 0.0 : log_uniform(seed, 1e-3, 3.0);
  p.law.eps = step == ANHYST_STEP_JA1986 ? uniform(seed, -5.0, 2.0) : 0.0;
  p.law.branch = &branch;
  if (step == ANHYST_STEP_EXACT) {
    /* With sanitizers, a table takes long to build. Therefore, several problems use one table. */
    if (branches_drawn++ % 25 == 0) {
      CHECK(anhyst_branch_build_f64(&branch, p.law.kappa) == ANHYST_OK);
    }
    p.law.kappa = branch.kappa;
  }
  p.from = random_state(seed, &p.law, reach);
  const double steepest_slope = anhyst_operator_steepest_f64(&p.law);
  const double steepness = low < 0.0 ? uniform(seed, low, high) : log_uniform(seed, low, high);
  p.omega = (steepness - 1.0) / steepest_slope;
  p.r = uniform(seed, -1.0, 1.0) * log_uniform(seed, 1e-3, 1.0) * (reach + fabs(p.omega));
  return p;
}

static double residual_in_ulps(const problem *p, const anhyst_candidate_f64 *found)
{
  const long double x = (long double)found->state.x;
  const long double omega = (long double)p->omega;
  const long double r = (long double)p->r;
  const long double left = x + omega * (long double)found->m - r;
  const long double unit = (long double)DBL_EPSILON * (fabsl(x) + fabsl(r) + fabsl(omega));
  return (double)(fabsl(left) / unit);
}

/* Returns the difference between a trial step and the law, evaluated at its end point. */
static double inconsistency(const problem *p, const anhyst_candidate_f64 *found)
{
  anhyst_path_f64 path;
  anhyst_answer_f64 answer;
  const double sign = found->state.x < p->from.x ? -1.0 : 1.0;
  anhyst_path_begin_f64(&path, &p->law, &p->from, sign, &answer);
  anhyst_path_at_f64(&path, found->state.x, &answer);
  const double off = fabs(answer.m - found->m) + fabs(answer.state.y - found->state.y) +
                     fabs(answer.state.p - found->state.p) / (1.0 + fabs(answer.state.p));
  return off;
}

static void solution_residual_is_rounding(anhyst_step step, double low, double high)
{
  uint64_t seed = 21 + (uint64_t)step;
  const int count = step == ANHYST_STEP_JA1986 ? 600 : 8000;
  double residual = 0.0;
  double answer = 0.0;
  double total = 0.0;
  int most = 0;
  for (int i = 0; i < count; i++) {
    const problem p = random_problem(&seed, step, low, high, log_uniform(&seed, 0.01, 300.0));
    const problem before = p;
    anhyst_candidate_f64 found;
    const anhyst_status status = anhyst_solve_f64(&p.law, &p.from, p.omega, p.r, &found);
    CHECK(status == ANHYST_OK);
    CHECK(memcmp(&before, &p, sizeof p) == 0);
    if (status == ANHYST_OK) {
      keep_largest(&residual, residual_in_ulps(&p, &found));
      keep_largest(&answer, inconsistency(&p, &found));
      total += found.evaluations;
      most = found.evaluations > most ? found.evaluations : most;
      CHECK(anhyst_state_check_f64(&p.law, &found.state) == ANHYST_OK);
    }
  }
  printf("step %d, 1 + omega*A from %g to %g:\n", (int)step, low, high);
  CHECK_BELOW("  residual in last places of |x| + |r| + |omega|", residual, 8.0);
  CHECK_BELOW("  candidate compared with the law at the same field", answer, 5e-12);
  CHECK_BELOW("  mean number of evaluations of the law", total / count, 7.0);
  CHECK_BELOW("  largest number of evaluations of the law", most, 60.0);
}

/* Follows the path in small steps. Returns whether a solution is clearly before the found one. */
static int passes_a_solution(const problem *p, const anhyst_candidate_f64 *found)
{
  anhyst_path_f64 path;
  anhyst_answer_f64 answer;
  const double way = found->state.x - p->from.x;
  const double sign = way < 0.0 ? -1.0 : 1.0;
  anhyst_path_begin_f64(&path, &p->law, &p->from, sign, &answer);
  const int steps = 3000;
  for (int i = 1; i < steps; i++) {
    const double x = p->from.x + way * ((double)i / (double)steps);
    anhyst_path_at_f64(&path, x, &answer);
    const double left = sign * (x + p->omega * answer.m - p->r);
    const double slack = 64.0 * DBL_EPSILON * (fabs(x) + fabs(p->r) + fabs(p->omega));
    if (left > slack) {
      return 1;
    }
  }
  return 0;
}

static void jump_selects_the_first_solution(anhyst_step step)
{
  uint64_t seed = 31 + (uint64_t)step;
  const int count = step == ANHYST_STEP_JA1986 ? 30 : 1000;
  double residual = 0.0;
  double most = 0.0;
  int passed = 0;
  int refused = 0;
  for (int i = 0; i < count; i++) {
    const double reach = log_uniform(&seed, 0.1, 30.0);
    const problem p = random_problem(&seed, step, -20.0, 0.0, reach);
    anhyst_candidate_f64 found;
    const anhyst_status status = anhyst_solve_f64(&p.law, &p.from, p.omega, p.r, &found);
    const int beyond = -p.omega * p.law.c > 3.0;
    CHECK(status == (beyond ? ANHYST_REFUSED : ANHYST_OK));
    refused += beyond;
    if (status == ANHYST_OK) {
      keep_largest(&residual, residual_in_ulps(&p, &found));
      keep_largest(&most, found.evaluations);
      passed += passes_a_solution(&p, &found);
    }
  }
  printf("step %d, jumps; %d of %d refused:\n", (int)step, refused, count);
  CHECK_BELOW("  residual in last places of |x| + |r| + |omega|", residual, 8.0);
  CHECK_BELOW("  solutions passed over", passed, 0.0);
  CHECK_BELOW("  largest number of evaluations of the law", most, 2000.0);
}

static void unchanged_demand_changes_no_state(void)
{
  uint64_t seed = 41;
  for (int i = 0; i < 2000; i++) {
    problem p = random_problem(&seed, ANHYST_STEP_EXACT, 0.05, 1e3, 10.0);
    anhyst_candidate_f64 found;
    p.r = p.from.x + p.omega * anhyst_operator_m_f64(&p.law, &p.from);
    CHECK(anhyst_solve_f64(&p.law, &p.from, p.omega, p.r, &found) == ANHYST_OK);
    CHECK(found.state.x == p.from.x && found.state.y == p.from.y && found.state.p == p.from.p);
  }
}

static void unsolvable_input_has_a_status(void)
{
  uint64_t seed = 42;
  const double nan = (double)NAN;
  const double inf = (double)INFINITY;
  const double bad[] = {nan, inf, -inf};
  for (int i = 0; i < 200; i++) {
    problem p = random_problem(&seed, (anhyst_step)(i % 3), 0.05, 1e3, 10.0);
    anhyst_candidate_f64 found;
    for (int j = 0; j < 3; j++) {
      CHECK(anhyst_solve_f64(&p.law, &p.from, p.omega, bad[j], &found) == ANHYST_OUT_OF_RANGE);
      const anhyst_status status = anhyst_solve_f64(&p.law, &p.from, bad[j], p.r, &found);
      CHECK(status == ANHYST_OUT_OF_RANGE || (bad[j] == -inf && status == ANHYST_REFUSED));
    }
    const double far = 1.1 * ANHYST_X_MAX + fabs(p.omega);
    CHECK(anhyst_solve_f64(&p.law, &p.from, p.omega, far, &found) == ANHYST_OUT_OF_RANGE);
    CHECK(anhyst_solve_f64(&p.law, &p.from, p.omega, 1e300, &found) == ANHYST_OUT_OF_RANGE);
  }
}

/* Any finite input ends with a status code after a limited number of evaluations. */
static void search_ends_at_any_magnitude(void)
{
  uint64_t seed = 43;
  int most = 0;
  int not_converged = 0;
  for (int i = 0; i < 20000; i++) {
    const anhyst_step step = i % 50 == 0 ? ANHYST_STEP_JA1986 : (anhyst_step)(i % 2);
    const double reach = step == ANHYST_STEP_JA1986 ? 100.0 : log_uniform(&seed, 1e-6, 8e4);
    problem p = random_problem(&seed, step, 0.05, 1e3, reach);
    const double sign = random_bits(&seed) % 2 == 0 ? 1.0 : -1.0;
    p.omega = sign * log_uniform(&seed, 1e-12, 1e30);
    const double size = log_uniform(&seed, 1e-12, 1.0);
    p.r = (uniform(&seed, -1.0, 1.0) * size *
           (step == ANHYST_STEP_JA1986 ? 100.0 + fabs(p.omega) : 1e6));
    p.law.c = random_bits(&seed) % 2 == 0 ? 0.0 : p.law.c;
    anhyst_candidate_f64 found;
    const anhyst_status status = anhyst_solve_f64(&p.law, &p.from, p.omega, p.r, &found);
    CHECK(status == ANHYST_OK || status == ANHYST_REFUSED || status == ANHYST_OUT_OF_RANGE ||
          status == ANHYST_NOT_CONVERGED);
    not_converged += status == ANHYST_NOT_CONVERGED;
    if (status == ANHYST_OK) {
      most = found.evaluations > most ? found.evaluations : most;
      CHECK(isfinite(found.state.x) && isfinite(found.m));
    }
  }
  CHECK_BELOW("not converged, of 20000 wild problems", not_converged, 0.0);
  CHECK_BELOW("largest number of evaluations of the law", most, 10000.0);
}

int main(void)
{
  const anhyst_step steps[] = {ANHYST_STEP_EXACT, ANHYST_STEP_LINEAR, ANHYST_STEP_JA1986};
  for (int i = 0; i < 3; i++) {
    solution_residual_is_rounding(steps[i], 0.05, 1.0);
    solution_residual_is_rounding(steps[i], 1.0, 1e6);
    jump_selects_the_first_solution(steps[i]);
  }
  unchanged_demand_changes_no_state();
  unsolvable_input_has_a_status();
  search_ends_at_any_magnitude();
  return verdict();
}
