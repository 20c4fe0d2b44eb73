/* SPDX-License-Identifier: Apache-2.0 */
#include "magnets.h"

#include "electromagnet_parameters.h"
#include "solenoid_parameters.h"

static anhyst_compensator compensators[MAGNETS];

int magnets_start(void)
{
  return anhyst_compensator_init(&compensators[ELECTROMAGNET], &ELECTROMAGNET_KERNEL,
                                 electromagnet_parameters,
                                 ELECTROMAGNET_PARAMETERS_WORDS) == ANHYST_OK &&
         anhyst_compensator_init(&compensators[SOLENOID], &SOLENOID_KERNEL, solenoid_parameters,
                                 SOLENOID_PARAMETERS_WORDS) == ANHYST_OK;
}

void magnets_solve(const int32_t demand[MAGNETS], const int32_t gap[MAGNETS],
                   int32_t current[MAGNETS])
{
  for (int i = 0; i < MAGNETS; i++) {
    current[i] = anhyst_compensator_solve_q31(&compensators[i], demand[i], gap[i]);
  }
}

void magnets_commit(const int32_t applied[MAGNETS], const int32_t gap[MAGNETS])
{
  for (int i = 0; i < MAGNETS; i++) {
    anhyst_compensator_commit_q31(&compensators[i], applied[i], gap[i]);
  }
}
