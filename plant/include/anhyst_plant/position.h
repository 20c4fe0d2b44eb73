/* SPDX-License-Identifier: Apache-2.0 */
/* The product's position controllers as a loop sees them. All that happens here is that signals in
   SI units become those of the number format, and back: codes in fixed point, casts in the others.
 */
#ifndef ANHYST_PLANT_POSITION_H
#define ANHYST_PLANT_POSITION_H

#include "anhyst/control/position.h"
#include "anhyst/control/position_real.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Which SI quantities the signals stand for. */
typedef struct {
  double gap_middle; /* gap at position 0, m */
  double position;   /* full scales, of fixed point alone: m */
  double current;    /* A */
  double demand;     /* N */
  double load;       /* N */
  double flux;       /* density, T */
} anhyst_position_scales;

typedef struct {
  anhyst_position_q31 *position;
  anhyst_position_scales scales;
} anhyst_position_adapter_q31;

typedef struct {
  anhyst_position_f64 *position;
  anhyst_position_scales scales;
} anhyst_position_adapter_f64;

typedef struct {
  anhyst_position_f32 *position;
  anhyst_position_scales scales;
} anhyst_position_adapter_f32;

/* As the tick of an anhyst_loop_controller whose self is the adapter. */
void anhyst_position_adapter_tick_q31(void *self, const anhyst_loop_sample *sample,
                                      anhyst_loop_answer *answer);
void anhyst_position_adapter_tick_f64(void *self, const anhyst_loop_sample *sample,
                                      anhyst_loop_answer *answer);
void anhyst_position_adapter_tick_f32(void *self, const anhyst_loop_sample *sample,
                                      anhyst_loop_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
