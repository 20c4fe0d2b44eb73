/* SPDX-License-Identifier: Apache-2.0 */
/* Claims of anhyst/generic/circuit.h: contracts, codes, and single against double precision. */
#include <string.h>

#include "check.h"
#include "laws.h"

static sample_iron sample;

static ANHYST_NAME(anhyst_circuit) some_circuit(uint64_t *seed)
{
  ANHYST_NAME(anhyst_circuit) circuit = {R(0.0), R(0.0)};
  if (random_bits(seed) % 2 == 0) {
    circuit.gap_ratio = (real)log_uniform(seed, 1e-4, 0.1);
    circuit.eddy = (real)(log_uniform(seed, 1e-5, 0.1) / ANHYST_MU0);
  }
  return circuit;
}

static int same_state(ANHYST_NAME(anhyst_state) one, ANHYST_NAME(anhyst_state) other)
{
  return memcmp(&one, &other, sizeof one) == 0;
}

static void solving_leaves_the_state_and_committing_advances_it(void)
{
  uint64_t seed = 51;
  for (int i = 0; i < 3000; i++) {
    if (!draw_iron(&seed, (anhyst_step)(i % 2), i % 3 == 0 ? WITH_PLAY : 0, &sample)) {
      continue;
    }
    const ANHYST_NAME(anhyst_circuit) circuit = some_circuit(&seed);
    const ANHYST_NAME(anhyst_state) before = wander(&seed, &sample.iron.law, 5.0);
    ANHYST_NAME(anhyst_state) state = before;
    ANHYST_NAME(anhyst_reaction) forward;
    ANHYST_NAME(anhyst_reaction) what_if;
    const real drive = (real)(sample.amplitude * uniform(&seed, -1.0, 1.0));
    CHECK(ANHYST_NAME(anhyst_forward)(&sample.iron, &state, &circuit, drive, &forward) ==
          ANHYST_OK);
    CHECK(same_state(state, before));
    CHECK(ANHYST_NAME(anhyst_inverse)(&sample.iron, &state, &circuit, R(0.5) * forward.flux,
                                      &what_if) == ANHYST_OK);
    CHECK(same_state(state, before));
    CHECK(ANHYST_NAME(anhyst_commit)(&sample.iron, &state, &circuit, drive) == ANHYST_OK);
    CHECK(same_state(state, forward.state));
    CHECK(forward.drive == drive);
    const double flux = (double)ANHYST_NAME(anhyst_flux_of)(&sample.iron, &state);
    CHECK(fabs(flux - (double)forward.flux) <=
          EITHER(1e-11, 4e-3) * (fabs(flux) + ANHYST_MU0 * (double)sample.iron.saturation));
  }
}

static void failure_leaves_the_state_of_the_last_good_sample(void)
{
  uint64_t seed = 52;
  const real bad[] = {(real)NAN, (real)INFINITY, -(real)INFINITY};
  for (int i = 0; i < 300; i++) {
    if (!draw_iron(&seed, (anhyst_step)(i % 3), 0, &sample)) {
      continue;
    }
    const real zeros[4] = {R(0.0), R(0.0), R(0.0), R(0.0)};
    real given[4];
    real found[4];
    real field[4];
    size_t index = 99;
    for (int j = 0; j < 4; j++) {
      given[j] = (real)(sample.amplitude * uniform(&seed, -1.0, 1.0));
    }
    ANHYST_NAME(anhyst_state) two = {R(0.0), R(0.0), R(0.0)};
    ANHYST_NAME(anhyst_state) state = two;
    CHECK(ANHYST_NAME(anhyst_record)(&sample.iron, &two, 0, 2, given, zeros, zeros, found, field,
                                     &index) == ANHYST_OK);
    given[2] = bad[i % 3];
    CHECK(ANHYST_NAME(anhyst_record)(&sample.iron, &state, 0, 4, given, zeros, zeros, found, field,
                                     &index) == ANHYST_OUT_OF_RANGE);
    CHECK(index == 2);
    CHECK(same_state(state, two));
    const ANHYST_NAME(anhyst_circuit) plain = {R(0.0), R(0.0)};
    CHECK(ANHYST_NAME(anhyst_commit)(&sample.iron, &state, &plain, bad[i % 3]) ==
          ANHYST_OUT_OF_RANGE);
    CHECK(same_state(state, two));
    ANHYST_NAME(anhyst_reaction) reaction;
    CHECK(ANHYST_NAME(anhyst_inverse)(&sample.iron, &state, &plain, bad[i % 3], &reaction) ==
          ANHYST_OUT_OF_RANGE);
  }
}

/* A gap ratio or eddy term that is no number must not pass for a solution. */
static void circuit_that_is_no_number_is_refused(void)
{
  uint64_t seed = 53;
  const real bad[] = {(real)NAN, (real)INFINITY};
  for (int i = 0; i < 200; i++) {
    if (!draw_iron(&seed, (anhyst_step)(i % 3), 0, &sample)) {
      continue;
    }
    const ANHYST_NAME(anhyst_state) state = {R(0.0), R(0.0), R(0.0)};
    const real drive = (real)sample.amplitude;
    const real flux = (real)(ANHYST_MU0 * sample.amplitude);
    for (int j = 0; j < 4; j++) {
      const ANHYST_NAME(anhyst_circuit) circuit = {j < 2 ? bad[j] : R(0.0),
                                                   j < 2 ? R(0.0) : bad[j - 2]};
      ANHYST_NAME(anhyst_reaction) reaction;
      CHECK(ANHYST_NAME(anhyst_forward)(&sample.iron, &state, &circuit, drive, &reaction) ==
            ANHYST_OUT_OF_RANGE);
      CHECK(ANHYST_NAME(anhyst_inverse)(&sample.iron, &state, &circuit, flux, &reaction) ==
            ANHYST_OUT_OF_RANGE);
    }
  }
}

static void parameters_out_of_range_are_refused(void)
{
  ANHYST_NAME(anhyst_iron) iron;
  const real nan = (real)NAN;
  const real inf = (real)INFINITY;
  const real good[6] = {R(1e6), R(100.0), R(80.0), R(0.2), R(1e-4), R(0.0)};
  const struct {
    int which;
    real value;
  } bad[] = {{0, R(0.0)},  {0, R(-1.0)}, {0, nan},    {0, inf},    {1, R(0.0)}, {1, R(-1.0)},
             {1, nan},     {1, inf},     {2, R(0.0)}, {2, R(1e6)}, {2, nan},    {2, inf},
             {3, R(-0.1)}, {3, R(1.1)},  {3, nan},    {4, R(1.0)}, {4, nan},    {4, -inf},
             {5, R(-1.0)}, {5, nan},     {5, inf}};
  const anhyst_step steps[] = {ANHYST_STEP_LINEAR, ANHYST_STEP_JA1986};
  for (int s = 0; s < 2; s++) {
    CHECK(ANHYST_NAME(anhyst_iron_init)(&iron, steps[s], good[0], good[1], good[2], good[3],
                                        good[4], good[5], 0) == ANHYST_OK);
    for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++) {
      real p[6];
      memcpy(p, good, sizeof p);
      p[bad[i].which] = bad[i].value;
      const anhyst_status status =
          ANHYST_NAME(anhyst_iron_init)(&iron, steps[s], p[0], p[1], p[2], p[3], p[4], p[5], 0);
      CHECK(status == ANHYST_BAD_PARAMETER);
      if (status != ANHYST_BAD_PARAMETER) {
        printf("  accepted: parameter %d = %g\n", bad[i].which, (double)bad[i].value);
      }
    }
  }
  CHECK(ANHYST_NAME(anhyst_iron_init)(&iron, ANHYST_STEP_EXACT, good[0], good[1], good[2], good[3],
                                      good[4], good[5], 0) == ANHYST_BAD_PARAMETER);
}

static void settling_closes_the_cycle_or_says_so(void)
{
  uint64_t seed = 54;
  const real zeros[12] = {R(0.0)};
  int unsettled = 0;
  int settled = 0;
  for (int i = 0; i < 300; i++) {
    if (!draw_iron(&seed, (anhyst_step)(i % 2), 0, &sample)) {
      continue;
    }
    real drive[12];
    for (int j = 0; j < 12; j++) {
      drive[j] =
          (real)(sample.amplitude * (0.5 + 0.5 * sin(2.0 * 3.14159265358979 * (double)j / 12.0)));
    }
    const real tol = EITHER(1e-10, 1e-4f);
    ANHYST_NAME(anhyst_state) state = {R(0.0), R(0.0), R(0.0)};
    int cycles = 0;
    size_t index = 0;
    const anhyst_status status = ANHYST_NAME(anhyst_settle)(
        &sample.iron, &state, 0, 12, drive, zeros, zeros, tol, 100000, &cycles, &index);
    CHECK(status == ANHYST_OK);
    settled += status == ANHYST_OK;
    const ANHYST_NAME(anhyst_state) before = state;
    CHECK(ANHYST_NAME(anhyst_record)(&sample.iron, &state, 0, 12, drive, zeros, zeros, 0, 0,
                                     &index) == ANHYST_OK);
    CHECK(fabs((double)(state.y - before.y)) <= 2.0 * (double)tol);
    ANHYST_NAME(anhyst_state) hasty = {R(0.0), R(0.0), R(0.0)};
    const anhyst_status one = ANHYST_NAME(anhyst_settle)(&sample.iron, &hasty, 0, 12, drive, zeros,
                                                         zeros, tol, 1, &cycles, &index);
    CHECK(one == ANHYST_OK || one == ANHYST_NOT_SETTLED);
    unsettled += one == ANHYST_NOT_SETTLED;
  }
  printf("%d cycles settled, %d not within one repetition\n", settled, unsettled);
  CHECK(settled > 100 && unsettled > 100);
}

#ifdef TEST_f32
#include "anhyst/f64.h"

static anhyst_branch_f64 double_branch;

/* The same path in both formats; by field, so that errors of the branch of a fold do not count. */
static void single_precision_follows_double(anhyst_step step)
{
  uint64_t seed = 55 + (uint64_t)step;
  double worst = 0.0;
  for (int i = 0; i < 400; i++) {
    if (!draw_iron(&seed, step, i % 3 == 0 ? WITH_PLAY : 0, &sample)) {
      continue;
    }
    const anhyst_iron_f32 *single = &sample.iron;
    anhyst_iron_f64 iron;
    if (step == ANHYST_STEP_EXACT) {
      CHECK(anhyst_branch_build_f64(&double_branch, (double)single->law.kappa) == ANHYST_OK);
    }
    iron.law.step = step;
    iron.law.kappa = (double)single->law.kappa;
    iron.law.c = (double)single->law.c;
    iron.law.play = (double)single->law.play;
    iron.law.eps = (double)single->law.eps;
    iron.law.branch = &double_branch;
    iron.saturation = (double)single->saturation;
    iron.shape = (double)single->shape;
    iron.interaction = (double)single->interaction;
    anhyst_state_f32 state = {0.0f, 0.0f, 0.0f};
    anhyst_state_f64 truth = {0.0, 0.0, 0.0};
    const anhyst_circuit_f32 plain = {0.0f, 0.0f};
    const anhyst_circuit_f64 double_plain = {0.0, 0.0};
    for (int j = 0; j < 36; j++) {
      const float drive = (float)(sample.amplitude * sin(0.5236 * (double)j + 0.1));
      anhyst_reaction_f32 found;
      anhyst_reaction_f64 expected;
      CHECK(anhyst_forward_f32(single, &state, &plain, drive, &found) == ANHYST_OK);
      CHECK(anhyst_forward_f64(&iron, &truth, &double_plain, (double)drive, &expected) ==
            ANHYST_OK);
      state = found.state;
      truth = expected.state;
      const double top = ANHYST_MU0 * (iron.saturation + sample.amplitude);
      keep_worst(&worst, fabs((double)found.flux - expected.flux) / top);
    }
  }
  printf("step %d:\n", (int)step);
  CHECK_BELOW("  single against double, over mu0*(M_s + H_max)", worst, 1e-4);
}
#endif

int main(void)
{
  solving_leaves_the_state_and_committing_advances_it();
  failure_leaves_the_state_of_the_last_good_sample();
  circuit_that_is_no_number_is_refused();
  parameters_out_of_range_are_refused();
  settling_closes_the_cycle_or_says_so();
#ifdef TEST_f32
  single_precision_follows_double(ANHYST_STEP_EXACT);
  single_precision_follows_double(ANHYST_STEP_LINEAR);
  single_precision_follows_double(ANHYST_STEP_JA1986);
#endif
  return verdict();
}
