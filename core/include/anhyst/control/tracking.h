/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of an axis that follows a set-point, in fixed point: error in, currents out. It
   joins filters (a notch at a resonance), a PID (error to net force), the force that is fed
   forward, the allocation of the net force to the drives, and a force controller for each drive
   (force to current). A stage between magnets has pairs of drives, a piezo stack a single one,
   whose force is a displacement and whose current is a voltage.

     net     = PID(filters(error)) + forward
     force   = allocation(net)
     current = what the drive's force controller makes of it, limited, on the converter's grid

   What is applied is committed to the force controllers at once.

   The PID is PIDD2 of the error with its second derivative, limits and back-calculation as they are
   set; the feedforward goes in as its load, at a full scale of its own. In floating point
   (tracking_real.h) the PID is a filter of second order, without limits: the same function of z
   where gains are made from the same poles.

   Signals are q31. The error is given, not two positions: a position over a long stroke needs more
   digits than what is left of it. Full scale of the net force is that of the force controllers'
   force, so that codes pass unchanged. Nothing here allocates memory, waits, or loops a number of
   times that depends on a signal. Declarations are in generic/tracking.h. */
#ifndef ANHYST_TRACKING_H
#define ANHYST_TRACKING_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/control/allocation.h"
#include "anhyst/control/biquad.h"
#include "anhyst/control/pidd2.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef anhyst_pidd2_gains_q31 anhyst_pid_q31;
typedef anhyst_pidd2_state_q31 anhyst_pid_state_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/control/generic/tracking.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
