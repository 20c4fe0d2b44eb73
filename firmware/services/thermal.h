/* SPDX-License-Identifier: Apache-2.0 */
/* I^2 t protection: estimates how warm a winding is from its current. The warmth models the
   temperature rise of one heat capacity that the square of the current heats:

       warmth += share*(current^2 - warmth) in each tick;   share = 1/(time constant in ticks)

   A constant current brings the warmth to the square of the current. The protection trips above the
   square of the continuous current limit and clears below the square of a lower current. The
   explicit Euler step leads the exact exponential by less than half a tick.

   Currents are any q30 of full scale, and the warmth is q60, 0..4.0. Each step rounds towards the
   present warmth and is too small by less than 2^-30*share. Therefore, a constant current ends
   within 2^-30 of its square. The warmth cannot saturate, because it stays between 0 and the
   largest square. */
#ifndef ANHYST_SERVICES_THERMAL_H
#define ANHYST_SERVICES_THERMAL_H

#include <stdint.h>

/* Step size and limits; filled by thermal_prepare. */
typedef struct {
  uint32_t mantissa;     /* share = mantissa/2^(30 + shift), mantissa 2^29..2^30 */
  uint16_t shift;        /* 0..32 */
  uint64_t trip_warmth;  /* limit of the warmth at which the protection trips, q60 */
  uint64_t clear_warmth; /* limit below which the protection clears, q60 */
} thermal_plan;

typedef struct {
  uint64_t warmth; /* q60 */
  int tripped;
} thermal;

/* Prepares a plan for a time constant in ticks and two currents (q30). Requires ticks >= 2 and 0 <
   clear_current < trip_current; returns 1, or 0 if this is not true. */
int thermal_prepare(thermal_plan *plan, uint32_t ticks, int32_t trip_current,
                    int32_t clear_current);

/* Starts at the warmth of the clearing current, because the time without power is unknown. */
void thermal_start(thermal *t, const thermal_plan *plan);

/* Updates the warmth by one tick of measured current. Returns 1 while the winding is too warm. */
int thermal_tick(thermal *t, const thermal_plan *plan, int32_t current);

#endif
