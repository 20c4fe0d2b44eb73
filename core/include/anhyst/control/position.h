/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a levitating armature, in fixed point: from its position to the coil currents.
   The controller combines three others: levitation (the sequence), PIDD2 (position to force), and a
   force controller for each magnet (force to current). Either one magnet pulls against a load, or
   two magnets pull against each other around a bias:

     F_1 = bias + u/2, F_2 = F_1 - u

   In each tick, the controller solves PIDD2 and the force controllers, limits the currents and
   rounds them to the converter's grid. The controller then commits the applied currents to the
   force controllers. If a limit applied, the integral of PIDD2 uses the force that the force
   controllers expect. Rounding does not count as a limit, because the model error would then appear
   as an error of the position.

   The applied current is the driven current or, if the settings request it, the current that is
   measured in the next tick.

   Signals are q31 of their full scales: position, load, force, current and flux density. Demand and
   force have the same full scale, so that the code of a demand is also the code of a force. No
   function allocates memory or waits. Every loop has an upper bound that does not depend on the
   signals. Declarations: generic/position.h. */
#ifndef ANHYST_POSITION_H
#define ANHYST_POSITION_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/control/levitation.h"
#include "anhyst/control/pidd2.h"

#define ANHYST_POSITION_MAGNETS 2

#ifdef __cplusplus
extern "C" {
#endif

/* Gap of a magnet, 0..1.0 of its range, from a position: offset + 2*factor*position. */
typedef struct {
  int32_t offset;
  anhyst_factor factor;
} anhyst_gap_line_q31;

typedef struct {
  anhyst_gap_line_q31 gap[ANHYST_POSITION_MAGNETS];
} anhyst_position_units_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/control/generic/position.h"
#include "anhyst/numeric/no_format.h"

/* Switches every magnet to another parameter block, between two ticks. Requires that the force
   controllers are compensators, and that the block is suitable for anhyst_compensator_swap. The
   control uses the new model immediately. The jump of the currents is added to the demanded
   currents and decreases by limits->release per tick. Therefore, the jump alone changes no current
   faster than that. A running conditioning sequence restarts. Takes about two solves per magnet. */
void anhyst_position_swap_q31(anhyst_position_q31 *c, const int16_t *words);

/* Switches the hysteresis compensation off or on again, between two ticks. While the compensation
   is off, settings->plain gives the currents. The compensators still commit them, so that their
   state remains that of the iron. Position control continues with the net force that the new method
   expects for the driven currents. The remaining jump of the currents decreases as after a swap.
   Requires that the magnets' force controllers are compensators. Returns ANHYST_OK, also if nothing
   changes, or ANHYST_BAD_PARAMETER without settings->plain. Takes about two solves per magnet. */
anhyst_status anhyst_position_compensate_q31(anhyst_position_q31 *c, int on);

/* Switches to other settings that differ only in the gains, between two ticks. The demand of the
   next tick does not change as long as the position is constant. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the gains are not valid; then nothing is changed. The new settings must
   live as long as the controller. The previous settings are no longer used. */
anhyst_status anhyst_position_retune_q31(anhyst_position_q31 *c,
                                         const anhyst_position_settings_q31 *settings);

#ifdef __cplusplus
}
#endif
#endif
