/* SPDX-License-Identifier: Apache-2.0 */
/* The product's position controllers as a loop sees them. All that happens here is that signals in
   SI units become those of the number format, and back: codes in fixed point, else casts. */
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

ANHYST_PLANT_ADAPTER(position, q31);
ANHYST_PLANT_ADAPTER(position, f64);
ANHYST_PLANT_ADAPTER(position, f32);

#ifdef __cplusplus
}
#endif
#endif
