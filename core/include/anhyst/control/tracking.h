/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a drive that follows a set-point, in double precision: from the control error
   to the input of an amplifier. The controller combines filters (a notch at a resonance), a PID
   controller, a feedforward demand, and a force controller. For a piezo stack, the "force" is a
   displacement and the "current" a voltage.

     demand = PID(filters(error)) + forward
     output = result of the force controller, limited and rounded to the converter's grid

   The PID controller is a second-order filter without limits. The applied output is committed to
   the force controller immediately. The input is the error instead of two positions, because
   positions in a long stroke need more digits than their difference. No function allocates memory
   or waits. Every loop has an upper bound that does not depend on the signals. For a body between
   magnets, see axes.h. */
#ifndef ANHYST_TRACKING_H
#define ANHYST_TRACKING_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/biquad.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Settings; constant. */
typedef struct {
  anhyst_biquad_f64 pid;
  double low; /* lowest and highest input of the amplifier */
  double high;
  double step;                     /* step of its D/A converter: low, low + step, ...; 0: no grid */
  const anhyst_biquad_f64 *filter; /* filters of the error in series; their number is `filters` */
  uint16_t filters;
} anhyst_tracking_settings;

/* A controller. */
typedef struct {
  const anhyst_tracking_settings *settings;
  anhyst_force_controller_f64 *drive;
  anhyst_biquad_state_f64 *filtered; /* state of each filter */
  anhyst_biquad_state_f64 state;     /* state of the PID controller */
} anhyst_tracking;

/* Results of a tick. */
typedef struct {
  double demand; /* input of the force controller */
  double output; /* limited and rounded output of the force controller */
} anhyst_tracking_answer;

/* Starts at standstill, as if the error had always been zero. Returns ANHYST_OK, or
   ANHYST_BAD_PARAMETER if the settings are not valid; then *c is unchanged. The structures behind
   the pointers must live as long as the controller. `filtered` may be null without filters. */
anhyst_status anhyst_tracking_init(anhyst_tracking *c, const anhyst_tracking_settings *settings,
                                   anhyst_force_controller_f64 *drive,
                                   anhyst_biquad_state_f64 *filtered);

/* Executes one tick with a control error and a feedforward demand. An error that is NaN does not
   change the filters; the demand is then NaN. The output stays within the limits for any input. */
anhyst_tracking_answer anhyst_tracking_tick(anhyst_tracking *c, double error, double forward);

#ifdef __cplusplus
}
#endif
#endif
