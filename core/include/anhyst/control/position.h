/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a levitating armature, in fixed point: position in, currents out. It joins
   levitation (what to do when), PIDD2 (position to force) and a force controller for each magnet
   (force to current). One magnet pulls against a load, or two pull against each other around a
   bias:

     F_1 = bias + u/2, F_2 = F_1 - u

   At every tick: solve PIDD2 and force controllers, limit the currents and round them to the grid
   of the converter, and commit to the force controllers what is applied. The integral of PIDD2
   learns from the force that the force controllers expect wherever a limit was in the way; a
   rounded current is no limit, for the error of a model would then show as an error of the
   position.

   Applied is what is driven or, if the settings say so, the current measured at the next tick.

   Signals are q31: position, load, force, current and flux density over their full scales. The full
   scale of the demand is that of the force controllers' force, so that codes pass unchanged.
   Nothing here allocates, waits, or loops a number of times that depends on a signal. Declarations
   are in generic/position.h. */
#ifndef ANHYST_POSITION_H
#define ANHYST_POSITION_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/control/levitation.h"
#include "anhyst/control/pidd2.h"

#define ANHYST_POSITION_MAGNETS 2

#ifdef __cplusplus
extern "C" {
#endif

/* How a position becomes a gap of a magnet, 0..1.0 over its range: offset + 2*factor*position. */
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

/* Goes on with another block in every drive, between two ticks. The drives are compensators, and
   the block is one that anhyst_compensator_swap may be given. The control goes on at once with the
   new model. What the currents would jump by is driven on beside what is wanted and fades by
   limits->release a tick, so that a swap in the air moves no current faster than that, whatever the
   controller asks for meanwhile. A conditioning sequence begins again. Costs about two solves a
   magnet. */
void anhyst_position_swap_q31(anhyst_position_q31 *c, const int16_t *words);

/* Switches the compensation of hysteresis off and on again, between two ticks: settings->plain
   gives the currents while it is off, and the compensators commit what is applied, so that their
   memory is that of the iron when they take over. A controlled armature goes on with the net force
   that the way switched to expects of what is driven; what the currents would still jump by fades
   as after a swap. The magnets' force controllers are compensators. ANHYST_OK, also where nothing
   changes, or ANHYST_BAD_PARAMETER where there is no plain map. Costs about two solves a magnet. */
anhyst_status anhyst_position_compensate_q31(anhyst_position_q31 *c, int on);

/* Goes on with other settings, which differ in the gains alone, between two ticks: the demand of
   the next tick is what it would have been, as far as the position stays. ANHYST_OK, or
   ANHYST_BAD_PARAMETER where the gains are not valid; nothing is changed then. What is pointed to
   must live on; the settings before are not looked at any more. */
anhyst_status anhyst_position_retune_q31(anhyst_position_q31 *c,
                                         const anhyst_position_settings_q31 *settings);

#ifdef __cplusplus
}
#endif
#endif
