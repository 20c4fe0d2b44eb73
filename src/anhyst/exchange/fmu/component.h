/* SPDX-License-Identifier: Apache-2.0 */
/* What an FMU holds, without either version of the standard: a controller's compensator that is
   sampled at its own rate.

   Between ticks the inputs of the last tick count. Everything of one instance is in its state,
   which may be copied byte by byte within a process. */
#ifndef ANHYST_FMU_COMPONENT_H
#define ANHYST_FMU_COMPONENT_H

#include "anhyst/compensator/compensator.h"

/* Value references; FMI 3.0 also knows the time as VARIABLE_TIME. */
enum { VARIABLE_TIME = 0, VARIABLE_DEMAND = 1, VARIABLE_GAP = 2, VARIABLE_CURRENT = 3 };

typedef struct {
  anhyst_compensator compensator;
  double inputs[2]; /* demand, in units of the output; gap, m */
  double current;   /* A */
  double start;     /* of the ticks, s */
  double time;      /* s */
  double ticks;     /* done since the start; whole */
} anhyst_component;

/* Starts with demagnetised iron at time 0. 0, or -1 where the parameters are damaged. */
int anhyst_component_start(anhyst_component *component);

/* Goes on to a time, s: every tick from now until before it, with the inputs as they are. */
void anhyst_component_advance(anhyst_component *component, double until);

/* Takes a state over that may come from another process: pointers stay those of this one. */
void anhyst_component_restore(anhyst_component *component, const anhyst_component *from);

/* Reads or writes a variable. 0, or -1 where there is none of that kind. */
int anhyst_component_get(const anhyst_component *component, unsigned reference, double *value);
int anhyst_component_set(anhyst_component *component, unsigned reference, double value);

#endif
