/* SPDX-License-Identifier: Apache-2.0 */
/* Proves a command, an external fault and a whole tick of the levitation sequence, from any state
   within the invariant, for any valid limits and settings and any input. */
#include "any.h"
#include "control/levitation.c"
#include "control/supervisor.c"

/* Returns any result; proofs/exhaustive/reach.c tries its product with every number. */
static int is_plausible(const anhyst_levitation *l, int32_t step, int32_t position)
{
  SHOW(step > 0);
  return nondet_i16() != 0;
}

/* The invariant of a state. The counter of a sequence does not exceed its length. */
static int is_invariant_true(const anhyst_levitation *l)
{
  const anhyst_supervisor *s = &l->supervisor;
  const int falls = l->phase != ANHYST_PHASE_FALL || (l->tick >= 0 && l->tick <= UINT16_MAX);
  const int counts = s->conditioning == 0U || (s->step >= -1 && s->step < INT32_MAX);
  return s->state < ANHYST_STATE_COUNT && l->phase < ANHYST_PHASE_COUNT && falls && counts;
}

int main(void)
{
  anhyst_levitation_limits limits; /* any */
  anhyst_levitation_settings settings;
  anhyst_levitation_input input;
  anhyst_levitation levitation;
  ASSUME(anhyst_levitation_check(&limits, &settings) == ANHYST_OK);
  ASSUME(is_invariant_true(&levitation));
  (void)anhyst_levitation_command(&levitation, nondet_u16(), nondet_u16());
  SHOW(is_invariant_true(&levitation));
  if (nondet_i16() != 0) {
    anhyst_levitation_fail(&levitation, nondet_u16(), nondet_i16());
    SHOW(levitation.supervisor.state == ANHYST_STATE_FAULT);
  }
  const uint16_t faulty = levitation.supervisor.state == ANHYST_STATE_FAULT ? 1U : 0U;
  const uint16_t fault = levitation.supervisor.fault;
  anhyst_levitation_tick(&levitation, &limits, &settings, &input);
  SHOW(is_invariant_true(&levitation));
  if (faulty != 0U && levitation.supervisor.state == ANHYST_STATE_FAULT) {
    SHOW(levitation.supervisor.fault == fault); /* the first fault reason is kept */
  }
  if ((levitation.flags & ANHYST_SAMPLE_IMPLAUSIBLE) == 0U) {
    SHOW(levitation.position >= limits.low && levitation.position <= limits.high);
  }
  anhyst_levitation_start(&levitation);
  SHOW(is_invariant_true(&levitation));
  return 0;
}
