/* SPDX-License-Identifier: Apache-2.0 */
/* Two magnets of different models in one program: wanted forces in, currents out.

   Signals are q31, each magnet's own: what 1.0 means stands in electromagnet_parameters.h and
   solenoid_parameters.h. */
#ifndef MAGNETS_H
#define MAGNETS_H

#include <stdint.h>

enum { ELECTROMAGNET, SOLENOID, MAGNETS };

/* Once, before the interrupt is enabled. Not 1 where parameters were damaged. */
int magnets_start(void);

/* At every tick: the currents that give the demanded forces, ... */
void magnets_solve(const int32_t demand[MAGNETS], const int32_t gap[MAGNETS],
                   int32_t current[MAGNETS]);

/* ... and those that were really applied. */
void magnets_commit(const int32_t applied[MAGNETS], const int32_t gap[MAGNETS]);

#endif
