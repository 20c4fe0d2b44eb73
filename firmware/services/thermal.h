/* SPDX-License-Identifier: Apache-2.0 */
/* I^2 t: how warm a winding is, as far as its current shows.

   The warmth follows the square of the current as a body of one heat capacity does,

     warmth += share*(current^2 - warmth)   at every tick, share = ticks of the time constant^-1

   and stands for the temperature above the surroundings: a current that flows for ever ends at its
   own square. It trips above the square of the current that may flow for ever, and clears below
   the square of a lower one. That is the explicit step; against the exponential it is warm too
   early by less than half a tick.

   Format     currents q30 of full scale, any number; warmth q60, 0 .. 4.0.
   Rounding   towards the warmth there is: each step falls short by less than 2^-30*share. A
              standing current ends within 2^-30 of its square.
   Saturation none is needed: the warmth lies between 0 and the largest square. */
#ifndef ANHYST_SERVICES_THERMAL_H
#define ANHYST_SERVICES_THERMAL_H

#include <stdint.h>

/* Shares of one time constant and limits; made by thermal_plan. */
typedef struct {
  uint32_t mantissa; /* share = mantissa/2^(30 + shift), mantissa 2^29..2^30 */
  uint16_t shift;    /* 0..32 */
  uint64_t trips;    /* q60, squares of the two currents */
  uint64_t clears;
} thermal_plan;

typedef struct {
  uint64_t warmth; /* q60 */
  int tripped;
} thermal;

/* Prepares for a time constant of so many ticks, 2 or more, and two currents, q30, 0 < clears <
   trips. 1, or 0 where they are not so. */
int thermal_make(thermal_plan *plan, uint32_t ticks, int32_t trips, int32_t clears);

/* Starts as warm as at the current that clears: nobody knows how long the power was off. */
void thermal_start(thermal *t, const thermal_plan *plan);

/* One tick with the current that flows. Whether it is too warm. */
int thermal_tick(thermal *t, const thermal_plan *plan, int32_t current);

#endif
