/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/batch.h for every instruction set of this processor. */
#include "anhyst/law/batch.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "laws.h"

#define MAX_SETS 130

static struct {
  double kappa[MAX_SETS], c[MAX_SETS], omega[MAX_SETS], scale[MAX_SETS], offset[MAX_SETS];
} drawn;

static anhyst_batch_sets random_sets(uint64_t *seed, size_t sets)
{
  for (size_t i = 0; i < sets; i++) {
    drawn.kappa[i] = log_uniform(seed, 0.1, 10.0);
    drawn.c[i] = uniform(seed, 0.0, 1.0);
    drawn.omega[i] =
        random_bits(seed) % 2 == 0 ? uniform(seed, -1.5, 0.0) : uniform(seed, 0.0, 10.0);
    drawn.scale[i] = log_uniform(seed, 0.1, 1.0);
    drawn.offset[i] = uniform(seed, -0.1, 0.1);
  }
  const anhyst_batch_sets all = {sets,        drawn.kappa, drawn.c,
                                 drawn.omega, drawn.scale, drawn.offset};
  return all;
}

static double *zeros(size_t n)
{
  double *values = calloc(n, sizeof *values);
  if (values == NULL) {
    abort();
  }
  return values;
}

typedef struct {
  double residual; /* error of x + omega*m = r, in units of a */
  double distance; /* deviation of m from the scalar linear step */
} errors;

/* Returns the largest errors over 1.5 loops of `samples` each, with r up to 3. */
static errors compare_with_scalar(anhyst_batch_level level, size_t sets, size_t samples)
{
  uint64_t seed = 61;
  const size_t n = samples + samples / 2;
  const anhyst_batch_sets all = random_sets(&seed, sets);
  double *drive = zeros(n);
  double *x = zeros(sets);
  double *y = zeros(sets);
  double *m_out = zeros(n * sets);
  double *x_out = zeros(n * sets);
  errors worst = {0.0, 0.0};
  for (size_t j = 0; j < n; j++) {
    drive[j] = 3.0 * sin(2.0 * 3.14159265358979 * (double)(j + 1) / (double)samples);
  }
  CHECK(anhyst_batch_f64(&all, level, ANHYST_BATCH_IMPLICIT, n, drive, x, y, m_out, x_out) ==
        ANHYST_OK);
  for (size_t i = 0; i < sets; i++) {
    const anhyst_operator_f64 law = {ANHYST_STEP_LINEAR, drawn.kappa[i], drawn.c[i], 0.0, 0.0, 0};
    anhyst_state_f64 state = {0.0, 0.0, 0.0};
    for (size_t j = 0; j < n; j++) {
      anhyst_candidate_f64 next;
      const double r = drawn.scale[i] * (drive[j] - drawn.offset[i]);
      CHECK(anhyst_solve_f64(&law, &state, drawn.omega[i], r, &next) == ANHYST_OK);
      state = next.state;
      const size_t at = j * sets + i;
      keep_largest(&worst.distance, fabs(m_out[at] - next.m));
      keep_largest(&worst.residual, fabs(x_out[at] + drawn.omega[i] * m_out[at] - r));
    }
    CHECK(x[i] == x_out[(n - 1) * sets + i]);
  }
  free(drive);
  free(x);
  free(y);
  free(m_out);
  free(x_out);
  return worst;
}

static void batch_agrees_with_the_scalar_linear_step(anhyst_batch_level level)
{
  const size_t sizes[] = {1, 63, 64, 65, MAX_SETS};
  errors worst = {0.0, 0.0};
  for (int i = 0; i < 5; i++) {
    const errors found = compare_with_scalar(level, sizes[i], 100);
    keep_largest(&worst.distance, found.distance);
    keep_largest(&worst.residual, found.residual);
  }
  const errors coarse = compare_with_scalar(level, 64, 100);
  const errors finer = compare_with_scalar(level, 64, 200);
  printf("level %d:\n", (int)level);
  CHECK_BELOW("  residual, 100 samples a loop", worst.residual, 2.5e-4);
  CHECK_BELOW("  m against the scalar linear step", worst.distance, 1e-5);
  CHECK_BELOW("  residual at 200 samples over that at 100", finer.residual / coarse.residual, 0.5);
}

static void inline_functions_have_the_stated_error(anhyst_batch_level level)
{
  enum { COUNT = 200000 };
  uint64_t seed = 62;
  double *t = zeros(COUNT);
  double *exp_minus = zeros(COUNT);
  double *langevin = zeros(COUNT);
  double exp_error = 0.0;
  double langevin_error = 0.0;
  for (int i = 0; i < COUNT; i++) {
    t[i] = i % 2 == 0 ? log_uniform(&seed, 1e-12, 680.0) : uniform(&seed, 0.0, 40.0);
  }
  CHECK(anhyst_batch_functions_f64(level, COUNT, t, exp_minus, langevin) == ANHYST_OK);
  for (int i = 0; i < COUNT; i++) {
    const long double z = (long double)t[i];
    keep_largest(&exp_error, (double)fabsl((long double)exp_minus[i] / expl(-z) - 1.0L));
    keep_largest(&langevin_error, (double)fabsl((long double)langevin[i] - true_langevin(z)));
  }
  free(t);
  free(exp_minus);
  free(langevin);
  printf("level %d:\n", (int)level);
  CHECK_BELOW("  relative error of exp", exp_error, 1e-11);
  CHECK_BELOW("  error of L", langevin_error, 4.4e-9);
}

static void outputs_are_optional(void)
{
  uint64_t seed = 63;
  const double drive[] = {0.5, 1.0, -0.5};
  const anhyst_batch_sets all = random_sets(&seed, 70);
  double x[2][70];
  double y[2][70];
  double m_out[3 * 70];
  double x_out[3 * 70];
  memset(x, 0, sizeof x);
  memset(y, 0, sizeof y);
  CHECK(anhyst_batch_f64(&all, ANHYST_BATCH_BASE, ANHYST_BATCH_IMPLICIT, 3, drive, x[0], y[0],
                         m_out, x_out) == ANHYST_OK);
  CHECK(anhyst_batch_f64(&all, ANHYST_BATCH_BASE, ANHYST_BATCH_IMPLICIT, 3, drive, x[1], y[1], 0,
                         0) == ANHYST_OK);
  CHECK(memcmp(x[0], x[1], sizeof x[0]) == 0);
  CHECK(memcmp(y[0], y[1], sizeof y[0]) == 0);
}

static void set_out_of_range_is_refused_without_a_change(void)
{
  uint64_t seed = 64;
  const double drive[] = {0.5};
  const double bad_kappa[] = {0.0, -1.0, (double)NAN};
  const double bad_c[] = {-0.1, 1.1, (double)NAN};
  const double bad_omega[] = {-3.0, -4.0, (double)NAN};
  for (int i = 0; i < 9; i++) {
    const anhyst_batch_sets all = random_sets(&seed, 65);
    double x[65] = {0.0};
    double y[65] = {0.0};
    double *where = i < 3 ? drawn.kappa : i < 6 ? drawn.c : drawn.omega;
    const double *bad = i < 3 ? bad_kappa : i < 6 ? bad_c : bad_omega;
    where[64] = bad[i % 3];
    CHECK(anhyst_batch_f64(&all, ANHYST_BATCH_BASE, ANHYST_BATCH_IMPLICIT, 1, drive, x, y, 0, 0) ==
          ANHYST_BAD_PARAMETER);
    CHECK(!(fabs(x[0]) > 0.0) && !(fabs(y[0]) > 0.0));
  }
}

static void missing_instruction_set_is_refused(void)
{
  uint64_t seed = 66;
  const double drive[] = {0.5};
  const anhyst_batch_level lacking = (anhyst_batch_level)(anhyst_batch_best() + 1);
  const anhyst_batch_sets all = random_sets(&seed, 1);
  double x[1] = {0.0};
  double y[1] = {0.0};
  CHECK(anhyst_batch_f64(&all, lacking, ANHYST_BATCH_IMPLICIT, 1, drive, x, y, 0, 0) ==
        ANHYST_BAD_PARAMETER);
  CHECK(anhyst_batch_functions_f64(lacking, 1, drive, x, y) == ANHYST_BAD_PARAMETER);
}

/* A drive that is NaN damages only the states of its sets, and the run ends. */
static void nan_drive_does_not_hang(void)
{
  uint64_t seed = 65;
  const double drive[] = {0.5, (double)NAN, (double)INFINITY, 1e300, -1e300, 0.5};
  const anhyst_batch_sets all = random_sets(&seed, 10);
  for (int mode = 0; mode < 2; mode++) {
    double x[10] = {0.0};
    double y[10] = {0.0};
    CHECK(anhyst_batch_f64(&all, ANHYST_BATCH_BASE, (anhyst_batch_mode)mode, 6, drive, x, y, 0,
                           0) == ANHYST_OK);
  }
}

int main(void)
{
  for (int level = 0; level <= (int)anhyst_batch_best(); level++) {
    batch_agrees_with_the_scalar_linear_step((anhyst_batch_level)level);
    inline_functions_have_the_stated_error((anhyst_batch_level)level);
  }
  missing_instruction_set_is_refused();
  outputs_are_optional();
  set_out_of_range_is_refused_without_a_change();
  nan_drive_does_not_hang();
  return verdict();
}
