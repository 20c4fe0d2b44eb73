/* SPDX-License-Identifier: Apache-2.0 */
/* The force controller of one magnet, in fixed point: wanted force in, current out, by one of

     map          current over force and gap without memory
     compensator  the inverse of hysteresis, with any kernel
     flux         a map, corrected until the measured flux density is the one of the wanted force
     fused        a compensator, corrected in the same way
     play         such a map with one play: force_by_play.h

   At every tick: solve once or more, limit and apply the current, then commit what was applied.
   solve keeps what it found for the commit, but changes neither the memory of the iron nor an
   integral. commit returns which force to expect, for the integral of whoever asked for the force.

   Signals are q31: force and current over their full scales, the gap 0..1.0 over its range, the
   flux density over its full scale. Declarations are in generic/force_controller.h. */
#ifndef ANHYST_FORCE_CONTROLLER_H
#define ANHYST_FORCE_CONTROLLER_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/numeric/factor.h"
#include "anhyst/compensator/map.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The flux density of a probe that is not there, or gave no sample. */
#define ANHYST_NO_FLUX ANHYST_Q31_MIN

/* How the measured flux corrects the current; constant. U is the full scale of the current, B that
   of the flux density, T the length of a tick. */
typedef struct {
  anhyst_map_q31 wanted;      /* flux density over the root of the force */
  anhyst_factor proportional; /* k_p*B/U */
  anhyst_factor integral;     /* k_i*T*B/U */
  anhyst_factor back;         /* share of applied - wanted that the integral takes in a tick in
                                 which the controller's limits cut the current */
  anhyst_factor smoothing;    /* minus the share of a step that is expected to show in a tick */
  int32_t most;               /* current that is added to that of a compensator at most, >= 0 */
} anhyst_flux_loop_q31;

typedef anhyst_compensator anhyst_compensator_q31;
typedef int16_t anhyst_block_q31; /* words of a parameter block */

/* expected, integral, error and flux are q30. */
#include "anhyst/numeric/q31.h"
#include "anhyst/compensator/generic/force_controller.h"
#include "anhyst/numeric/no_format.h"

anhyst_status anhyst_force_controller_init_compensator_q31(anhyst_force_controller_q31 *c,
                                                           const anhyst_kernel *kernel,
                                                           const int16_t *words, uint16_t capacity);

#ifdef __cplusplus
}
#endif
#endif
