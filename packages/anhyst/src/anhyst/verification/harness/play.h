/* SPDX-License-Identifier: Apache-2.0 */
/* Defines the names of signals.h for a map with one play operator; signals.h includes this file.
 * The single-valued current replaces the flux, and the play replaces the applied flux. */
#ifndef HARNESS_PLAY_H
#define HARNESS_PLAY_H

typedef anhyst_play_map_q31 compensator_state;
#define PARAMETERS_WORDS ACTUATOR_PARAMETERS_WORDS
#define SOLVE anhyst_play_map_solve_q31
#define COMMIT (void)anhyst_play_map_commit_q31
#define OUTPUT(c) ((c)->demand)
#define FLUX_OF(c) inner_word((c)->at.value)
#define FLUX_APPLIED_OF(c) inner_word((c)->play)

/* A map with one play operator has no start-up sequence. */
#define CONDITIONING(c, tick) ((void)(c), (void)(tick), (signal)0)
#define CONDITIONING_LENGTH(c) ((void)(c), (int32_t)0)

static inline anhyst_status take_parameters(compensator_state *c)
{
  return anhyst_play_map_init_q31(c, ACTUATOR_PARAMETERS, PARAMETERS_WORDS);
}

static inline void record_memory(const compensator_state *c, uint32_t *record)
{
  record[HARNESS_MEMORY_A] = (uint32_t)c->play;
  record[HARNESS_MEMORY_B] = (uint32_t)c->at.current;
  record[HARNESS_MEMORY_C] = 0;
  record[HARNESS_MEMORY_D] = 0;
  record[HARNESS_MEMORY_E] = 0;
}

#endif
