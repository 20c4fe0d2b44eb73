/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a drive that follows a set-point, in double precision: error in, output of a
   converter out. It joins filters (a notch at a resonance), a PID, what is fed forward, and a force
   controller. On a piezo stack its force is a displacement and its current is a voltage.

     demand = PID(filters(error)) + forward
     output = what the force controller makes of it, limited, on the converter's grid

   The PID is a filter of second order, without limits. What is applied is committed to the force
   controller at once. The error is given, not two positions: a position over a long stroke needs
   more digits than what is left of it. Nothing here allocates memory, waits, or loops a number of
   times that depends on a signal. A body between magnets has the controller of axes.h. */
#ifndef ANHYST_TRACKING_H
#define ANHYST_TRACKING_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/biquad.h"

#ifdef __cplusplus
extern "C" {
#endif

/* How the drive is controlled; constant. */
typedef struct {
  anhyst_biquad_f64 pid;
  double low; /* limits of what the amplifier accepts */
  double high;
  double step;                     /* of its converter: outputs are low, low + step, ...; 0: none */
  const anhyst_biquad_f64 *filter; /* of the error, `filters` of them, one after another */
  uint16_t filters;
} anhyst_tracking_settings;

/* One controller. */
typedef struct {
  const anhyst_tracking_settings *settings;
  anhyst_force_controller_f64 *drive;
  anhyst_biquad_state_f64 *filtered; /* one for each filter */
  anhyst_biquad_state_f64 state;     /* of the PID */
} anhyst_tracking;

/* What follows from a tick. */
typedef struct {
  double demand; /* what is asked of the force controller */
  double output; /* to drive */
} anhyst_tracking_answer;

/* Starts at rest: zero error for ever. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not
   valid; nothing is changed then. What is pointed to must live as long as the controller; filtered
   may be 0 without filters. */
anhyst_status anhyst_tracking_init(anhyst_tracking *c, const anhyst_tracking_settings *settings,
                                   anhyst_force_controller_f64 *drive,
                                   anhyst_biquad_state_f64 *filtered);

/* One tick: an error over which the drive is to push, and what is fed forward. An error that is no
   number stays in no filter. The output stays within the limits whatever is given. */
anhyst_tracking_answer anhyst_tracking_tick(anhyst_tracking *c, double error, double forward);

#ifdef __cplusplus
}
#endif
#endif
