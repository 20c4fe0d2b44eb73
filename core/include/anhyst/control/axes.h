/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a body with one to six coordinates and any number of drives, in floating point:
   readings of position heads in, currents out.

     pose    = see*heads, relative to the target
     error   = decouple*(reference - pose)
     wrench  = weigh*PID(error) + forward
     force   = allocation of the wrench to the drives, see wrench.h
     current = result of each drive's force controller, limited and rounded to the converter's grid

   decouple transforms errors to the centre of mass, and weigh contains the masses about it. Each
   PID then sees a mass of one, and no axis disturbs another. The PIDs are second-order filters
   (biquad.h) without limits. The applied currents are committed to the force controllers
   immediately.

   If an error exceeds its reach or is NaN, no PID advances: the last plausible demand is kept, and
   ANHYST_SAMPLE_IMPLAUSIBLE is set. Therefore, wrong readings never wind up an integral. The caller
   decides how many of them are too many.

   A drive whose current stays away from its command is lost. It gets no more commands, and the
   others share the wrench. `spare` states the drives without which the body can continue. If
   another drive is lost, or two of them, the body lands. A head is lost if it reads NaN, jumps or
   does not change. The body then lands with the other heads if they are sufficient for the pose;
   otherwise all drives are switched off.

   The body is levitated from the first tick. Commands of states.h: IDLE releases it immediately.
   LIFT moves it from its position at rest to the target, each axis at a limited speed; it is
   refused if anything is lost. LAND moves the reference down until the body is at rest. Other
   commands are refused.

   Head readings are relative to the readings at the target. Single precision resolves 1 nm over 8
   mm only, so subtract integers or doubles before rounding. Declarations: generic/axes.h. */
#ifndef ANHYST_AXES_H
#define ANHYST_AXES_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/biquad.h"
#include "anhyst/control/states.h"
#include "anhyst/control/wrench.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_AXES_HEADS 16
#define ANHYST_AXES_ODD 8U /* increase of the doubt about a head that jumps */

typedef enum {
  ANHYST_AXES_FLY,
  ANHYST_AXES_LAND,
  ANHYST_AXES_REST,
  ANHYST_AXES_LIFT
} anhyst_axes_state;

/* A matrix by rows, and the PID of an axis. axes_fixed.h has types with more members. */
typedef const double *anhyst_rows_f64;
typedef const float *anhyst_rows_f32;
typedef anhyst_biquad_f64 anhyst_axis_pid_f64;
typedef anhyst_biquad_f32 anhyst_axis_pid_f32;
typedef anhyst_biquad_state_f64 anhyst_axis_pid_state_f64;
typedef anhyst_biquad_state_f32 anhyst_axis_pid_state_f32;

#include "anhyst/numeric/f64.h"
#include "anhyst/control/generic/axes.h"
#include "anhyst/numeric/f32.h"
#include "anhyst/control/generic/axes.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
