/* SPDX-License-Identifier: Apache-2.0 */
/* Additions of a simulated loop to the controllers of axes.h: a drive in single precision for a
   controller in double precision, and the state word of a controller in recordings. */
#ifndef ANHYST_PLANT_AXES_H
#define ANHYST_PLANT_AXES_H

#include "anhyst/compensator/force_controller_real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Initialises a controller in double precision that calls a force controller in single precision.
   The inner controller must live as long as this one. For fixed point see force_coded_real.h. */
void anhyst_axes_drive_init_f32(anhyst_force_controller_f64 *c, anhyst_force_controller_f32 *force);

/* Returns the state of a controller and its lost magnets: 16*(state of states.h) + phase +
   256*(highest number of a lost magnet). */
uint16_t anhyst_axes_state_word(uint16_t state, uint32_t lost);

#ifdef __cplusplus
}
#endif
#endif
