/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a body with one to six coordinates (axes) and any number of drives, in floating
   point: from the readings of position sensors (heads) to the coil currents.

     pose    = see*heads, relative to the target
     error   = decouple*(reference - pose)
     wrench  = weigh*PID(error) + forward
     force   = allocation of the wrench to the drives, see wrench.h
     current = result of each drive's force controller, limited and rounded to the converter's grid

   The matrix `decouple` transforms errors to the centre of mass, and the matrix `weigh` contains
   the mass and the moments of inertia. Each PID controller then sees a mass of one, and no axis
   disturbs another. The PID controllers are second-order filters (biquad.h) without limits. The
   applied currents are committed to the force controllers immediately.

   If an error exceeds its limit `reach` or is NaN, no PID controller advances. The last plausible
   demand is kept, and ANHYST_SAMPLE_IMPLAUSIBLE is set. Therefore, wrong readings never cause
   integrator windup. The caller decides how many such ticks are too many.

   A drive is lost if its current deviates from the command for too long. A lost drive gets no more
   commands, and the other drives make the wrench. The body can continue without one of the drives
   in the bit mask `spare`. After the loss of any other drive, or of a second one, the body lands. A
   head is lost if it reads NaN, jumps or does not change. The body then lands with the other heads
   if they are sufficient for the pose. Otherwise, all drives are switched off.

   The body is levitated from the first tick. Three commands of states.h are accepted. IDLE switches
   the drives off immediately. LIFT moves the body from its rest position to the target, each axis
   at a limited speed; it is refused if a drive or a head is lost. LAND moves the reference down
   until the body is at rest. All other commands are refused.

   Head readings are relative to the readings at the target. Single precision resolves 1 nm only in
   a range of 8 mm, so subtract integers or doubles first. Declarations: generic/axes.h. */
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
#define ANHYST_AXES_ODD 8U /* amount that a jump adds to the doubt counter of a head */

typedef enum {
  ANHYST_AXES_FLY,
  ANHYST_AXES_LAND,
  ANHYST_AXES_REST,
  ANHYST_AXES_LIFT
} anhyst_axes_state;

/* A matrix, stored by rows, and the PID controller of an axis; axes_fixed.h has its own types. */
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
