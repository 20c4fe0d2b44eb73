/* SPDX-License-Identifier: Apache-2.0 */
/* The product's tracking controllers as a loop sees them. All that happens here is that signals in
   SI units become those of the number format, and back: codes in fixed point, casts in the others.
   The first drive is at the measured gap, the second at what is left of both gaps. */
#ifndef ANHYST_PLANT_TRACKING_H
#define ANHYST_PLANT_TRACKING_H

#include "anhyst/control/axes.h"
#include "anhyst/control/tracking.h"
#include "anhyst/control/tracking_real.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Drives behind an adapter at most. */
#define ANHYST_TRACKING_MOST_DRIVES 16

/* Which SI quantities the signals of fixed point stand for. */
typedef struct {
  double error;    /* full scales: m */
  double forward;  /* N */
  double demand;   /* N */
  double current;  /* A */
  double flux;     /* density, T */
  double gap_low;  /* range of the gap, m */
  double gap_high; /* m */
} anhyst_tracking_scales;

/* Makes a force controller in double precision that asks one in single precision, which must live
   as long; for one in fixed point see force_coded_real.h. */
void anhyst_tracking_drive_init_f32(anhyst_force_controller_f64 *c,
                                    anhyst_force_controller_f32 *force);

/* The tick is that of an anhyst_loop_controller whose self is the adapter. target is the wanted
   position, load the net force that is fed forward, N. */
#define ANHYST_TRACKING_ADAPTER(f)                                                                 \
  typedef struct {                                                                                 \
    anhyst_tracking_##f *tracking;                                                                 \
    anhyst_tracking_scales scales;                                                                 \
    double gap_total; /* of both gaps, m */                                                        \
  } anhyst_tracking_adapter_##f;                                                                   \
  void anhyst_tracking_adapter_tick_##f(void *self, const anhyst_loop_sample *sample,              \
                                        anhyst_loop_answer *answer)
ANHYST_TRACKING_ADAPTER(q31);
ANHYST_TRACKING_ADAPTER(f64);
ANHYST_TRACKING_ADAPTER(f32);
#undef ANHYST_TRACKING_ADAPTER

/* The state of a controller of several coordinates, and what it has lost, as an answer has them. */
uint16_t anhyst_axes_word(uint16_t state, uint32_t lost);

#ifdef __cplusplus
}
#endif
#endif
