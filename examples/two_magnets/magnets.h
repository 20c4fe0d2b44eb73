/* SPDX-License-Identifier: Apache-2.0 */
/* Two magnets with different models in one program: converts demanded forces to currents.

   Signals are q31. electromagnet_parameters.h and solenoid_parameters.h define the scale of each
   magnet. */
#ifndef MAGNETS_H
#define MAGNETS_H

#include <stdint.h>

enum { ELECTROMAGNET, SOLENOID, MAGNETS };

/* Call once, before the interrupt is enabled. Returns 1, or 0 if parameters are damaged. */
int magnets_start(void);

/* Returns the currents for the demanded forces. Call at every tick. */
void magnets_solve(const int32_t demand[MAGNETS], const int32_t gap[MAGNETS],
                   int32_t current[MAGNETS]);

/* Stores the currents that were applied. Call at every tick after magnets_solve. */
void magnets_commit(const int32_t applied[MAGNETS], const int32_t gap[MAGNETS]);

#endif
