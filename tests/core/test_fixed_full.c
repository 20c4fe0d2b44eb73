/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of the parts of the Jiles-Atherton law in fixed point (table, decay, one evaluation of a
   path), compared with double and long double precision. */
/* The test calls their static functions. */
#include "compensator/full.c" /* NOLINT(bugprone-suspicious-include) */

#include "check.h"
#include "full_words.h"
#include "truth.h"

static const double FULL_Q26 = 67108864.0;
static const double FULL_Q28 = 268435456.0;

/* A rising table with irregular steps. */
static void fill_entries(int16_t *entries, int count, uint64_t *seed)
{
  const int32_t most = 60000 / count;
  int32_t level = -30000;
  for (int i = 0; i <= count; i++) {
    entries[i] = (int16_t)level;
    level += (int32_t)(random_bits(seed) % (uint64_t)(most + 1));
  }
}

/* Linear between the entries, with an error below the rise of a segment times 2^-28. */
static void tables_are_linear_between_entries(void)
{
  static int16_t entries[MOST_SEGMENTS + 1];
  uint64_t seed = 5;
  double worst = 0.0;
  for (uint16_t n = 3; n <= 9; n++) {
    const int count = 1 << n;
    const table t = {entries, n};
    fill_entries(entries, count, &seed);
    for (int i = 0; i < 50000; i++) {
      const int32_t u = (int32_t)(random_bits(&seed) % (uint64_t)ONE);
      const double place = (double)u / FULL_Q28 * count;
      const int segment = (int)place;
      const double step = (double)entries[segment + 1] - entries[segment];
      const double exact = (entries[segment] + step * (place - segment)) * 8192.0;
      int32_t rise;
      const double found = (double)interpolate(t, u, &rise);
      CHECK(rise == entries[segment + 1] - entries[segment]);
      keep_largest(&worst, fabs(found - exact) / (step + 1e-9));
      CHECK(found <= exact);
    }
    for (int i = 0; i < count; i++) {
      int32_t rise;
      CHECK(interpolate(t, i * (ONE >> n), &rise) == entries[i] * 8192);
    }
  }
  CHECK_BELOW("table, units in the last place over the rise of a segment", worst, 1.0);
}

static void decay_is_exponential(void)
{
  double worst = 0.0;
  double relative = 0.0;
  double fall = 0.0;
  int32_t before = 0;
  for (int64_t way = 0; way <= ANHYST_Q31_MAX; way += way < 4096 ? 1 : 1009) {
    const double octaves = (double)way / FULL_Q26;
    const double exact = -expm1(-octaves * log(2.0));
    const int32_t found = decayed_fraction((int32_t)way);
    keep_largest(&worst, fabs((double)found / FULL_Q28 - exact));
    if (way > 0 && octaves < 1.0) {
      keep_largest(&relative, (fabs((double)found - exact * FULL_Q28) - 1.0) / (exact * FULL_Q28));
    }
    CHECK(found >= 0 && found <= ONE);
    keep_largest(&fall, (double)(before - found) / FULL_Q28);
    before = found;
  }
  CHECK_BELOW("1 - 2^-t", worst, 7e-5);
  CHECK_BELOW("the same below an octave, relative", relative, 1.5e-4);
  CHECK_BELOW("fall of 1 - 2^-t where an octave ends", fall, 7e-5);
}

/* The irreversible part after a rise from x0, y0 to x1. */
static double irreversible_part(double kappa, double x0, double y0, double x1)
{
  return (double)true_irreversible((long double)kappa, (long double)x0, (long double)y0,
                                   (long double)x1);
}

/* Errors of y and m after one monotone path from a point on the initial magnetisation curve. */
static void path_errors(double kappa, double c, double *error_y, double *error_m)
{
  uint64_t seed = 23;
  prepare_law(kappa, c, 0.0);
  for (int i = 0; i < 400; i++) {
    const double x0 = uniform(&seed, -3.5, 3.5);
    const double y0 = irreversible_part(kappa, 0.0, 0.0, x0);
    const double x1 = uniform(&seed, x0, 3.9);
    branch_path path;
    anhyst_full_memory from;
    from.x = (int32_t)lrint(x0 / REACH * ANHYST_Q30_ONE);
    from.y = (int32_t)lrint(y0 * ANHYST_Q30_ONE);
    from.p = from.x;
    from.reversal_play = from.x;
    from.reversal_y = from.y;
    init_branch_path(&path, words, &from, 0);
    find_y_start(&path, words, &from, 0);
    const path_point point = evaluate_path(&path, (int32_t)lrint(x1 / REACH * FULL_Q28));
    const double y1 = irreversible_part(kappa, x0, y0, x1);
    const double m1 = (1.0 - c) * y1 + c * langevin(x1);
    keep_largest(error_y, fabs((double)point.y / FULL_Q28 - y1));
    keep_largest(error_m, fabs((double)point.m / FULL_Q28 - m1));
  }
}

static void monotone_path_is_exact(void)
{
  static const double KAPPAS[] = {0.1, 0.5, 1.5, 5.0};
  double error_y = 0.0;
  double error_m = 0.0;
  for (int i = 0; i < 4; i++) {
    path_errors(KAPPAS[i], 0.2, &error_y, &error_m);
  }
  CHECK_BELOW("irreversible part", error_y, 2e-4);
  CHECK_BELOW("magnetisation", error_m, 2e-4);
}

/* Returns the magnetisation at x1 after a monotone path from a given start. */
static double magnetisation_after_path(double kappa, double c, const double *start, double x1)
{
  const double sign = x1 < start[0] ? -1.0 : 1.0;
  const double y = sign * irreversible_part(kappa, sign * start[0], sign * start[1], sign * x1);
  return (1.0 - c) * y + c * langevin(x1);
}

/* Returns the largest error of field and magnetisation, divided by the range of x, compared with a
   bisection of the true law. The iron has a negative weight: `share` of the weight at which the
   left side would be constant. */
static double error_with_negative_iron(double kappa, double c, double share, int16_t evaluations)
{
  uint64_t seed = 31;
  double worst = 0.0;
  prepare_law(kappa, c, 0.0);
  words[ANHYST_WORD_FULL_ITERATIONS] = evaluations;
  const int16_t air = 20000;
  const int16_t iron = nearest(-share * 3.0 / REACH * air);
  for (int i = 0; i < 300; i++) {
    const double x0 = uniform(&seed, -3.0, 3.0);
    const double start[2] = {x0, irreversible_part(kappa, 0.0, 0.0, x0)};
    const double x1 = uniform(&seed, -3.5, 3.5);
    const double m1 = magnetisation_after_path(kappa, c, start, x1);
    const int32_t target = (int32_t)lrint((air * x1 / REACH + iron * m1) / 65536.0 * FULL_Q28);
    anhyst_compensator state = {0};
    const anhyst_full_memory from = {
        (int32_t)lrint(x0 / REACH * ANHYST_Q30_ONE), (int32_t)lrint(start[1] * ANHYST_Q30_ONE),
        (int32_t)lrint(x0 / REACH * ANHYST_Q30_ONE), (int32_t)lrint(x0 / REACH * ANHYST_Q30_ONE),
        (int32_t)lrint(start[1] * ANHYST_Q30_ONE)};
    const anhyst_arms arms = {0, iron, air};
    state.words = words;
    state.memory.full = from;
    state.arms = arms;
    const int32_t flux = flux_for_current(&state, target * 4);
    const anhyst_full_memory to = state.next.memory.full;
    const double m =
        (flux - anhyst_scale(to.x, words[ANHYST_WORD_FULL_AIR]) * 4) / (FULL_Q28 * 4.0);
    keep_largest(&worst, fabs((double)to.x / ANHYST_Q30_ONE - x1 / REACH));
    keep_largest(&worst, fabs(m - m1) / REACH);
  }
  return worst;
}

/* The true law has one solution, so that the start point must be found again. */
static void negative_iron_weight_is_solved(void)
{
  CHECK_BELOW("a quarter against the air, 5 evaluations",
              error_with_negative_iron(0.5, 0.2, 0.25, 5), 1e-4);
  CHECK_BELOW("three quarters, 3 evaluations", error_with_negative_iron(0.5, 0.2, 0.75, 3), 3e-4);
  CHECK_BELOW("nearly all, 12 evaluations", error_with_negative_iron(0.1, 0.8, 0.99, 12), 3e-3);
  CHECK_BELOW("nearly all, wide loops", error_with_negative_iron(1.5, 0.2, 0.99, 6), 1e-3);
}

static void falling_current_is_refused(void)
{
  const int first = ANHYST_BLOCK_LEAST_WORDS + 3 * (2 * MOST_SEGMENTS + 1) - 4;
  const double c = 0.3;
  prepare_law(0.5, c, 0.0);
  words[ANHYST_WORD_FULL_AIR] = 300;
  words[ANHYST_WORD_GAP_SEGMENTS] = 0;
  words[ANHYST_WORD_GAP_FLUX_ARM] = (int16_t)first;
  words[ANHYST_WORD_GAP_FIELD_ARM] = (int16_t)(first + 2);
  double steepest_slope = 0.0; /* dm/dx for fields up to 1 */
  for (int i = 0; i < 300; i++) {
    const double x = 0.01 * i;
    const double irreversible = (langevin(x) - branch_at(0.5, x)) / 0.5;
    const double reversible = (langevin(x + 1e-4) - langevin(x - 1e-4)) / 2e-4;
    steepest_slope = fmax(steepest_slope, REACH * ((1.0 - c) * irreversible + c * reversible));
  }
  for (int gap = 0; gap < 2; gap++) {
    words[first] = words[first + 1] = 5000;
    words[first + 2] = words[first + 3] = 20000;
    CHECK(does_current_rise_with_field(words));
    const double most = 20000.0 / (steepest_slope + 4.0 * 300.0 / 65536.0);
    words[first + gap] = (int16_t)-lrint(0.98 * most);
    CHECK(does_current_rise_with_field(words));
    words[first + gap] = (int16_t)-lrint(1.02 * most);
    CHECK(!does_current_rise_with_field(words));
  }
}

int main(void)
{
  tables_are_linear_between_entries();
  decay_is_exponential();
  monotone_path_is_exact();
  negative_iron_weight_is_solved();
  falling_current_is_refused();
  return verdict();
}
