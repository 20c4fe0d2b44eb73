/* SPDX-License-Identifier: Apache-2.0 */
/* Random laws, states and irons of every kind, in the format a test is compiled for. */
#ifndef TEST_LAWS_H
#define TEST_LAWS_H

#include "anhyst/circuit.h"

#include "format.h"
#include "truth.h"

/* What a set may contain. */
enum { MAY_JUMP = 1, WITH_PLAY = 2, EXTREME = 4 };

typedef struct {
  ANHYST_NAME(anhyst_iron) iron;
  ANHYST_NAME(anhyst_branch) branch;
  double amplitude; /* of the field to drive it with, A/m */
} sample_iron;

/* Fills a sample; its iron points into it, so it must not be copied. Returns 0 if the set drawn is
   outside what the core accepts. */
static inline int draw_iron(uint64_t *seed, anhyst_step step, int what, sample_iron *out)
{
  const int extreme = (what & EXTREME) != 0;
  const double saturation = log_uniform(seed, 1e4, 2e6);
  const double shape = log_uniform(seed, 1.0, 1e4);
  const double lowest = step == ANHYST_STEP_JA1986 ? 0.1 : 0.05;
  const double kappa = log_uniform(seed, extreme ? 1.1e-3 : lowest, extreme ? 900.0 : 5.0);
  const double c = random_bits(seed) % 10 == 0 ? 0.0 : uniform(seed, 0.0, extreme ? 1.0 : 0.9);
  /* alpha*A: above 1 the magnetisation jumps; the reversible part must not, c*alpha*A < 1. */
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
  const real pinning = (real)(kappa * shape);
  const real play = (real)((what & WITH_PLAY) ? shape * kappa * uniform(seed, 0.01, 0.5) : 0.0);
  if (step == ANHYST_STEP_EXACT) {
    ANHYST_NAME(anhyst_branch_build)(&out->branch, pinning / (real)shape);
  }
  const double shear = shape + (alpha < 0.0 ? -alpha * saturation / 3.0 : 0.0);
  out->amplitude = log_uniform(seed, 0.3, extreme ? 300.0 : 30.0) * shear;
  return ANHYST_NAME(anhyst_iron_init)(&out->iron, step, (real)saturation, (real)shape, pinning,
                                       (real)c, (real)alpha, play, &out->branch) == ANHYST_OK;
}

/* A state reached by wandering from the demagnetised one, by effective field. */
static inline ANHYST_NAME(anhyst_state)
wander(uint64_t *seed, const ANHYST_NAME(anhyst_operator) *law, double spread)
{
  ANHYST_NAME(anhyst_state) state = {R(0.0), R(0.0), R(0.0)};
  const int steps = (int)(random_bits(seed) % 8);
  for (int i = 0; i < steps; i++) {
    ANHYST_NAME(anhyst_path) path;
    ANHYST_NAME(anhyst_answer) answer;
    const real x = (real)uniform(seed, -spread, spread);
    ANHYST_NAME(anhyst_path_begin)(&path, law, &state, x < state.x ? R(-1.0) : R(1.0), &answer);
    ANHYST_NAME(anhyst_path_at)(&path, x, &answer);
    state = answer.state;
  }
  return state;
}

#endif
