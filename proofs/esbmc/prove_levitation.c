/* SPDX-License-Identifier: Apache-2.0 */
/* A whole tick of what a levitating actuator does when, from any state within the invariant, for
   any sound limits and settings and any input. */
#include "any.h"
#include "levitation.c"

/* Any answer; its product is tried with every number (proofs/exhaustive/reach.c). */
static int is_reachable(const anhyst_levitation *l, int32_t step, int32_t position)
{
  SHOW(step > 0);
  return nondet_i16() != 0;
}

/* What a state always is. A sequence counts no further than it is long. */
static int holds(const anhyst_levitation *l)
{
  const int counted = l->phase == ANHYST_PHASE_HOLD        ? l->tick >= 0 && l->tick <= UINT16_MAX
                      : l->phase == ANHYST_PHASE_CONDITION ? l->tick >= -1 && l->tick < INT32_MAX
                                                           : 1;
  return l->state <= ANHYST_LEVITATION_FAULT && l->phase <= ANHYST_PHASE_CONDITION && counted &&
         (l->phase != ANHYST_PHASE_CONDITION || l->state == ANHYST_LEVITATION_IDLE ||
          l->state == ANHYST_LEVITATION_FAULT);
}

int main(void)
{
  anhyst_levitation_limits limits; /* any */
  anhyst_levitation_settings settings;
  anhyst_levitation_input input;
  anhyst_levitation levitation;
  ASSUME(anhyst_levitation_check(&limits, &settings) == ANHYST_OK);
  ASSUME(holds(&levitation));
  const uint16_t faulty = levitation.state == ANHYST_LEVITATION_FAULT ? 1U : 0U;
  const uint16_t fault = levitation.fault;
  anhyst_levitation_tick(&levitation, &limits, &settings, &input);
  SHOW(holds(&levitation));
  if (faulty != 0U && levitation.state == ANHYST_LEVITATION_FAULT) {
    SHOW(levitation.fault == fault); /* the first reason stays */
  }
  if ((levitation.flags & ANHYST_SAMPLE_DOUBTFUL) == 0U) {
    SHOW(levitation.position >= limits.low && levitation.position <= limits.high);
  }
  anhyst_levitation_start(&levitation);
  SHOW(holds(&levitation));
  return 0;
}
