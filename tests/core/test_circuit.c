/* SPDX-License-Identifier: Apache-2.0 */
/* Tests of anhyst/law/circuit.h: contracts, codes, and single against double precision. */
#include <string.h>

#include "check.h"
#include "laws.h"

static sample_iron sample;

static anhyst_circuit_f64 make_circuit(uint64_t *seed)
{
  anhyst_circuit_f64 circuit = {0.0, 0.0};
  if (random_bits(seed) % 2 == 0) {
    circuit.gap_ratio = log_uniform(seed, 1e-4, 0.1);
    circuit.eddy = log_uniform(seed, 1e-5, 0.1) / ANHYST_MU0;
  }
  return circuit;
}

static anhyst_memory_f64 demagnetised(void)
{
  anhyst_memory_f64 state;
  memset(&state, 0, sizeof state);
  return state;
}

static int is_same_state(anhyst_memory_f64 one, anhyst_memory_f64 other)
{
  return memcmp(&one.lag, &other.lag, sizeof one.lag) == 0;
}

static void solve_keeps_and_commit_advances_the_state(void)
{
  uint64_t seed = 51;
  for (int i = 0; i < 3000; i++) {
    if (!make_random_iron(&seed, (anhyst_step)(i % 2), i % 3 == 0 ? WITH_PLAY : 0, &sample)) {
      continue;
    }
    const anhyst_circuit_f64 circuit = make_circuit(&seed);
    anhyst_memory_f64 before = demagnetised();
    before.lag = random_state(&seed, &sample.law, 5.0);
    anhyst_memory_f64 state = before;
    anhyst_reaction_f64 forward;
    anhyst_reaction_f64 what_if;
    const double drive = sample.amplitude * uniform(&seed, -1.0, 1.0);
    CHECK(anhyst_forward_f64(&sample.iron, &state, &circuit, drive, &forward) == ANHYST_OK);
    CHECK(is_same_state(state, before));
    CHECK(anhyst_inverse_f64(&sample.iron, &state, &circuit, 0.5 * forward.flux, &what_if) ==
          ANHYST_OK);
    CHECK(is_same_state(state, before));
    CHECK(anhyst_commit_f64(&sample.iron, &state, &circuit, drive) == ANHYST_OK);
    anhyst_memory_f64 accepted = before;
    anhyst_accept_f64(&sample.iron, &accepted, &forward);
    CHECK(is_same_state(state, accepted));
    CHECK(forward.drive == drive);
    const double flux = anhyst_flux_of_f64(&sample.iron, &state);
    CHECK(fabs(flux - forward.flux) <= 1e-11 * (fabs(flux) + ANHYST_MU0 * sample.iron.saturation));
  }
}

static void failure_keeps_the_last_valid_state(void)
{
  uint64_t seed = 52;
  const double bad[] = {(double)NAN, (double)INFINITY, -(double)INFINITY};
  for (int i = 0; i < 300; i++) {
    if (!make_random_iron(&seed, (anhyst_step)(i % 3), 0, &sample)) {
      continue;
    }
    const double zeros[4] = {0.0, 0.0, 0.0, 0.0};
    double given[4];
    double found[4];
    double field[4];
    size_t index = 99;
    for (int j = 0; j < 4; j++) {
      given[j] = sample.amplitude * uniform(&seed, -1.0, 1.0);
    }
    anhyst_memory_f64 two = demagnetised();
    anhyst_memory_f64 state = two;
    CHECK(anhyst_record_f64(&sample.iron, &two, 0, 2, given, zeros, zeros, found, field, &index) ==
          ANHYST_OK);
    given[2] = bad[i % 3];
    CHECK(anhyst_record_f64(&sample.iron, &state, 0, 4, given, zeros, zeros, found, field,
                            &index) == ANHYST_OUT_OF_RANGE);
    CHECK(index == 2);
    CHECK(is_same_state(state, two));
    const anhyst_circuit_f64 plain = {0.0, 0.0};
    CHECK(anhyst_commit_f64(&sample.iron, &state, &plain, bad[i % 3]) == ANHYST_OUT_OF_RANGE);
    CHECK(is_same_state(state, two));
    anhyst_reaction_f64 reaction;
    CHECK(anhyst_inverse_f64(&sample.iron, &state, &plain, bad[i % 3], &reaction) ==
          ANHYST_OUT_OF_RANGE);
  }
}

/* A gap ratio or an eddy term that is NaN must not give a solution. */
static void nan_circuit_is_refused(void)
{
  uint64_t seed = 53;
  const double bad[] = {(double)NAN, (double)INFINITY};
  for (int i = 0; i < 200; i++) {
    if (!make_random_iron(&seed, (anhyst_step)(i % 3), 0, &sample)) {
      continue;
    }
    const anhyst_memory_f64 state = demagnetised();
    const double drive = sample.amplitude;
    const double flux = ANHYST_MU0 * sample.amplitude;
    for (int j = 0; j < 4; j++) {
      const anhyst_circuit_f64 circuit = {j < 2 ? bad[j] : 0.0, j < 2 ? 0.0 : bad[j - 2]};
      anhyst_reaction_f64 reaction;
      CHECK(anhyst_forward_f64(&sample.iron, &state, &circuit, drive, &reaction) ==
            ANHYST_OUT_OF_RANGE);
      CHECK(anhyst_inverse_f64(&sample.iron, &state, &circuit, flux, &reaction) ==
            ANHYST_OUT_OF_RANGE);
    }
  }
}

static void parameters_out_of_range_are_refused(void)
{
  anhyst_iron_f64 iron;
  anhyst_operator_f64 law;
  const double nan = (double)NAN;
  const double inf = (double)INFINITY;
  const double good[6] = {1e6, 100.0, 80.0, 0.2, 1e-4, 0.0};
  const struct {
    int which;
    double value;
  } bad[] = {{0, 0.0}, {0, -1.0}, {0, nan}, {0, inf},  {1, 0.0},  {1, -1.0}, {1, nan},
             {1, inf}, {2, 0.0},  {2, 1e6}, {2, nan},  {2, inf},  {3, -0.1}, {3, 1.1},
             {3, nan}, {4, 1.0},  {4, nan}, {4, -inf}, {5, -1.0}, {5, nan},  {5, inf}};
  const anhyst_step steps[] = {ANHYST_STEP_LINEAR, ANHYST_STEP_JA1986};
  for (int s = 0; s < 2; s++) {
    CHECK(anhyst_iron_init_f64(&iron, &law, steps[s], good[0], good[1], good[2], good[3], good[4],
                               good[5], 0) == ANHYST_OK);
    for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++) {
      double p[6];
      memcpy(p, good, sizeof p);
      p[bad[i].which] = bad[i].value;
      const anhyst_status status =
          anhyst_iron_init_f64(&iron, &law, steps[s], p[0], p[1], p[2], p[3], p[4], p[5], 0);
      CHECK(status == ANHYST_BAD_PARAMETER);
      if (status != ANHYST_BAD_PARAMETER) {
        printf("  accepted: parameter %d = %g\n", bad[i].which, bad[i].value);
      }
    }
  }
  CHECK(anhyst_iron_init_f64(&iron, &law, ANHYST_STEP_EXACT, good[0], good[1], good[2], good[3],
                             good[4], good[5], 0) == ANHYST_BAD_PARAMETER);
}

static void settling_closes_the_cycle_or_fails(void)
{
  uint64_t seed = 54;
  const double zeros[12] = {0.0};
  int unsettled = 0;
  int settled = 0;
  for (int i = 0; i < 300; i++) {
    if (!make_random_iron(&seed, (anhyst_step)(i % 2), 0, &sample)) {
      continue;
    }
    double drive[12];
    for (int j = 0; j < 12; j++) {
      drive[j] = sample.amplitude * (0.5 + 0.5 * sin(2.0 * 3.14159265358979 * (double)j / 12.0));
    }
    const double tol = 1e-10;
    anhyst_memory_f64 state = demagnetised();
    int cycles = 0;
    size_t index = 0;
    const anhyst_status status = anhyst_settle_f64(&sample.iron, &state, 0, 12, drive, zeros, zeros,
                                                   tol, 100000, &cycles, &index);
    CHECK(status == ANHYST_OK);
    settled += status == ANHYST_OK;
    const anhyst_memory_f64 before = state;
    CHECK(anhyst_record_f64(&sample.iron, &state, 0, 12, drive, zeros, zeros, 0, 0, &index) ==
          ANHYST_OK);
    CHECK(fabs(state.lag.y - before.lag.y) <= 2.0 * tol);
    anhyst_memory_f64 hasty = demagnetised();
    const anhyst_status one = anhyst_settle_f64(&sample.iron, &hasty, 0, 12, drive, zeros, zeros,
                                                tol, 1, &cycles, &index);
    CHECK(one == ANHYST_OK || one == ANHYST_NOT_SETTLED);
    unsettled += one == ANHYST_NOT_SETTLED;
  }
  printf("%d cycles settled, %d not within one repetition\n", settled, unsettled);
  CHECK(settled > 100 && unsettled > 100);
}

int main(void)
{
  solve_keeps_and_commit_advances_the_state();
  failure_keeps_the_last_valid_state();
  nan_circuit_is_refused();
  parameters_out_of_range_are_refused();
  settling_closes_the_cycle_or_fails();
  return verdict();
}
