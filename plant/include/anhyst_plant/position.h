/* SPDX-License-Identifier: Apache-2.0 */
/* The product's position controllers as controllers of a loop. This adapter only converts signals
   between SI units and the number format: codes in fixed point, casts in floating point. */
#ifndef ANHYST_PLANT_POSITION_H
#define ANHYST_PLANT_POSITION_H

#include "anhyst/control/position.h"
#include "anhyst/control/position_real.h"
#include "anhyst_plant/controller.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Scales of the signals. */
typedef struct {
  double gap_middle; /* gap at position 0, m */
  double position;   /* full scale of the position, m; only fixed point needs full scales */
  double current;    /* A */
  double demand;     /* N */
  double load;       /* N */
  double flux;       /* full scale of the flux density, T */
} anhyst_position_scales;

ANHYST_PLANT_DECLARE_ADAPTER(position, q31);
ANHYST_PLANT_DECLARE_ADAPTER(position, f64);
ANHYST_PLANT_DECLARE_ADAPTER(position, f32);

#ifdef __cplusplus
}
#endif
#endif
