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
  double error;     /* full scales: m */
  double forward;   /* N */
  double demand;    /* N */
  double current;   /* A */
  double flux;      /* density, T */
  double gap_low;   /* range of the gap, m */
  double gap_high;  /* m */
  double gap_total; /* in every format: of both gaps, m */
} anhyst_tracking_scales;

/* Makes a force controller in double precision that asks one in single precision, which must live
   as long; for one in fixed point see force_coded_real.h. */
void anhyst_tracking_drive_init_f32(anhyst_force_controller_f64 *c,
                                    anhyst_force_controller_f32 *force);

/* target is the wanted position, load the net force that is fed forward, N. */
ANHYST_PLANT_ADAPTER(tracking, q31);
ANHYST_PLANT_ADAPTER(tracking, f64);
ANHYST_PLANT_ADAPTER(tracking, f32);

/* The state of a controller of several coordinates, and what it has lost, as an answer has them. */
uint16_t anhyst_axes_word(uint16_t state, uint32_t lost);

#ifdef __cplusplus
}
#endif
#endif
