/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a drive that follows a set-point, in double precision: error in, output of a
   converter out. It combines filters (a notch at a resonance), a PID, a feedforward demand, and a
   force controller. For a piezo stack, the "force" is a displacement and the "current" a voltage.

     demand = PID(filters(error)) + forward
     output = result of the force controller, limited and rounded to the converter's grid

   The PID is a second-order filter without limits. The applied output is committed to the force
   controller immediately. The input is the error instead of two positions, because positions over a
   long stroke need more digits than their difference. No function allocates memory, waits, or has a
   loop whose length depends on a signal. For a body between magnets, see axes.h. */
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
  double low; /* limits of the amplifier's input */
  double high;
  double step;                     /* step of its converter: low, low + step, ...; 0: no grid */
  const anhyst_biquad_f64 *filter; /* filters of the error in series, `filters` of them */
  uint16_t filters;
} anhyst_tracking_settings;

/* A controller. */
typedef struct {
  const anhyst_tracking_settings *settings;
  anhyst_force_controller_f64 *drive;
  anhyst_biquad_state_f64 *filtered; /* one for each filter */
  anhyst_biquad_state_f64 state;     /* of the PID */
} anhyst_tracking;

/* Results of a tick. */
typedef struct {
  double demand; /* input of the force controller */
  double output; /* to drive */
} anhyst_tracking_answer;

/* Starts at rest: the error was always zero. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER, without a
   change, if the settings are not valid. The structures behind the pointers must live as long as
   the controller; filtered may be 0 without filters. */
anhyst_status anhyst_tracking_init(anhyst_tracking *c, const anhyst_tracking_settings *settings,
                                   anhyst_force_controller_f64 *drive,
                                   anhyst_biquad_state_f64 *filtered);

/* Executes one tick with a control error and a feedforward demand. An error that is NaN does not
   change the filters. The output stays within the limits for any input. */
anhyst_tracking_answer anhyst_tracking_tick(anhyst_tracking *c, double error, double forward);

#ifdef __cplusplus
}
#endif
#endif
