/* SPDX-License-Identifier: Apache-2.0 */
/* The force controller of one magnet in fixed point: from the demanded force to the coil current.
   There are five methods:

     map          The current is a single-valued function of force and gap.
     compensator  An inverse hysteresis model with any kernel gives the current.
     flux         A map, corrected until the measured flux density is that of the demanded force.
     fused        A compensator, corrected in the same way.
     play         A map with one play operator, see force_by_play.h.

   In each tick, call solve, limit and apply the current, then commit the current that was applied.
   solve stores its result for the commit, but changes neither the hysteresis state nor an integral.
   commit returns the expected force, for the integral of the outer controller.

   Signals are q31. Force, current and flux density are fractions of their full scales. A gap of
   0..1.0 is the range of gaps. Declarations: generic/force_controller.h. */
#ifndef ANHYST_FORCE_CONTROLLER_H
#define ANHYST_FORCE_CONTROLLER_H

#include "anhyst/compensator/compensator.h"
#include "anhyst/numeric/factor.h"
#include "anhyst/compensator/map.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Value of a flux density that means: there is no probe, or no sample in this tick. */
#define ANHYST_NO_FLUX ANHYST_Q31_MIN

/* Parameters of the flux loop, which corrects the current by the measured flux density; constant. U
   is the full scale of the current, B that of the flux density, and T the length of a tick. */
typedef struct {
  anhyst_map_q31 flux_table;  /* flux density as a function of the square root of the force */
  anhyst_factor proportional; /* proportional gain, k_p*B/U */
  anhyst_factor integral;     /* integral gain, k_i*T*B/U */
  anhyst_factor back;         /* back-calculation gain: if the current is limited, this fraction of
                                 `applied - unlimited_current` is added to the integral */
  anhyst_factor smoothing;    /* minus the expected fraction of a flux step after one tick, -1..0 */
  int32_t most;               /* largest current that is added to that of a compensator, >= 0 */
} anhyst_flux_loop_q31;

typedef anhyst_compensator anhyst_compensator_q31;
typedef int16_t anhyst_block_q31; /* a word of a parameter block */

/* The members expected, integral, error and flux of the next structure are q30. */
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
