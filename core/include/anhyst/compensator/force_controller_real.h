/* SPDX-License-Identifier: Apache-2.0 */
/* The force controller of force_controller.h in floating point, in the units of the model. A flux
   density of NaN means that there is no probe. */
#ifndef ANHYST_FORCE_CONTROLLER_REAL_H
#define ANHYST_FORCE_CONTROLLER_REAL_H

#include "anhyst/compensator/compensator_real.h"
#include "anhyst/compensator/map_real.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A word of a parameter block. */
typedef double anhyst_block_f64;
typedef float anhyst_block_f32;

#include "anhyst/numeric/f64.h"
#include "anhyst/compensator/generic/flux_loop.h"
#include "anhyst/compensator/generic/force_controller.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/compensator/generic/flux_loop.h"
#include "anhyst/compensator/generic/force_controller.h"
#include "anhyst/numeric/no_format.h"

anhyst_status anhyst_force_controller_init_compensator_f64(anhyst_force_controller_f64 *c,
                                                           const anhyst_kernel_f64 *kernel,
                                                           const double *words, uint32_t capacity);
anhyst_status anhyst_force_controller_init_compensator_f32(anhyst_force_controller_f32 *c,
                                                           const anhyst_kernel_f32 *kernel,
                                                           const float *words, uint32_t capacity);

#ifdef __cplusplus
}
#endif
#endif
