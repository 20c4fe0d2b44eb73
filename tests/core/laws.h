/* SPDX-License-Identifier: Apache-2.0 */
/* Random laws, states and irons of every kind, in the number format of the test. */
#ifndef TEST_LAWS_H
#define TEST_LAWS_H

#include "anhyst/law/circuit.h"

#include "truth.h"

/* Properties that a sample may have. */
enum { MAY_JUMP = 1, WITH_PLAY = 2, EXTREME = 4 };

typedef struct {
  anhyst_iron_f64 iron;
  anhyst_operator_f64 law;
  anhyst_branch_f64 branch;
  double amplitude; /* of the field that drives it, A/m */
} sample_iron;

/* Fills a sample. Its iron contains pointers into it, so it must not be copied. Returns 0 if the
   core does not accept the random parameters. */
static inline int make_random_iron(uint64_t *seed, anhyst_step step, int what, sample_iron *out)
{
  const int extreme = (what & EXTREME) != 0;
  const double saturation = log_uniform(seed, 1e4, 2e6);
  const double shape = log_uniform(seed, 1.0, 1e4);
  const double lowest = step == ANHYST_STEP_JA1986 ? 0.1 : 0.05;
  const double kappa = log_uniform(seed, extreme ? 1.1e-3 : lowest, extreme ? 900.0 : 5.0);
  const double c = random_bits(seed) % 10 == 0 ? 0.0 : uniform(seed, 0.0, extreme ? 1.0 : 0.9);
  /* alpha*A: above 1 the magnetisation jumps. The reversible part must not jump: c*alpha*A < 1. */
  double coupling = uniform(seed, 0.0, 0.95);
  if ((what & MAY_JUMP) != 0) {
    coupling = uniform(seed, 1.05, 6.0);
  } else if (random_bits(seed) % 2 == 0) {
    coupling = uniform(seed, -10.0, 0.0);
  }
  const double alpha = 3.0 * shape * coupling / saturation;
  if (alpha >= 0.999 || c * coupling > 0.95) {
    return 0;
  }
  const double pinning = (kappa * shape);
  const double play = ((what & WITH_PLAY) ? shape * kappa * uniform(seed, 0.01, 0.5) : 0.0);
  if (step == ANHYST_STEP_EXACT) {
    anhyst_branch_build_f64(&out->branch, pinning / shape);
  }
  const double shear = shape + (alpha < 0.0 ? -alpha * saturation / 3.0 : 0.0);
  out->amplitude = log_uniform(seed, 0.3, extreme ? 300.0 : 30.0) * shear;
  return anhyst_iron_init_f64(&out->iron, &out->law, step, saturation, shape, pinning, c, alpha,
                              play, &out->branch) == ANHYST_OK;
}

/* Returns a state after random effective fields from the demagnetised state. */
static inline anhyst_state_f64 random_state(uint64_t *seed, const anhyst_operator_f64 *law,
                                            double spread)
{
  anhyst_state_f64 state = {0.0, 0.0, 0.0};
  const int steps = (int)(random_bits(seed) % 8);
  for (int i = 0; i < steps; i++) {
    anhyst_path_f64 path;
    anhyst_answer_f64 answer;
    const double x = uniform(seed, -spread, spread);
    anhyst_path_begin_f64(&path, law, &state, x < state.x ? -1.0 : 1.0, &answer);
    anhyst_path_at_f64(&path, x, &answer);
    state = answer.state;
  }
  return state;
}

#endif
