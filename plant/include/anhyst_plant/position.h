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

/* The tick is that of an anhyst_loop_controller whose self is the adapter. */
#define ANHYST_POSITION_ADAPTER(f)                                                                 \
  typedef struct {                                                                                 \
    anhyst_position_##f *position;                                                                 \
    anhyst_position_scales scales;                                                                 \
  } anhyst_position_adapter_##f;                                                                   \
  void anhyst_position_adapter_tick_##f(void *self, const anhyst_loop_sample *sample,              \
                                        anhyst_loop_answer *answer)
ANHYST_POSITION_ADAPTER(q31);
ANHYST_POSITION_ADAPTER(f64);
ANHYST_POSITION_ADAPTER(f32);
#undef ANHYST_POSITION_ADAPTER

#ifdef __cplusplus
}
#endif
#endif
