/* SPDX-License-Identifier: Apache-2.0 */
/* A compensator with a simple rule, in place of the core's. It records how it was called. The
   current is half the demand, and the memory follows the committed current. */
#ifndef TEST_FAKE_COMPENSATOR_H
#define TEST_FAKE_COMPENSATOR_H

#include "anhyst/compensator/compensator.h"

#include <stddef.h>

#define FAKE_EXTRA_CURRENT                                                                         \
  ANHYST_WORD_FULL_AIR /* word of the block: current in addition to half the demand, q15 */
#define FAKE_CYCLES 2
#define FAKE_CYCLE_TICKS 4
#define FAKE_CONDITION_STEP ((int32_t)0x00010000)

typedef struct {
  int solves;
  int commits;
  int32_t solved_gap;
  int32_t committed;
  int32_t committed_gap;
} fake_calls;

extern fake_calls fake;
extern const anhyst_kernel fake_kernel;

/* Fills a block that passes the check of this compensator. */
void fake_block(int16_t *words, uint16_t length, uint16_t generation);

#endif
