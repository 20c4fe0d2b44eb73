/* SPDX-License-Identifier: Apache-2.0 */
/* What a loop adds to the controllers of axes.h: drives in single precision behind a controller in
   double precision, and the state of a controller as a recording has it. */
#ifndef ANHYST_PLANT_AXES_H
#define ANHYST_PLANT_AXES_H

#include "anhyst/compensator/force_controller_real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Makes a force controller in double precision that asks one in single precision, which must live
   as long; for one in fixed point see force_coded_real.h. */
void anhyst_axes_drive_init_f32(anhyst_force_controller_f64 *c, anhyst_force_controller_f32 *force);

/* The state of a controller, and what it has lost: 16 times the state of states.h, its phase, and
   256 times the highest number of a magnet that is lost. */
uint16_t anhyst_axes_word(uint16_t state, uint32_t lost);

#ifdef __cplusplus
}
#endif
#endif
