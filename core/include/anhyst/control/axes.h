/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a body of one to six coordinates on any number of drives, in floating point:
   position heads in, currents out.

     pose    = see*heads, counted from the target
     error   = decouple*(what is aimed at - pose)
     wrench  = weigh*PID(error) + forward
     force   = wrench shared out, see wrench.h
     current = what each drive's force controller makes of it, limited, on the converter's grid

   With decouple taking errors to the centre of mass and weigh the masses about it, every PID sees a
   mass of one and no axis pushes another. The PIDs are filters of second order
   (biquad.h), without limits. What is applied is committed to the force controllers at once.

   Where an error is beyond its reach, or no number, no PID of any axis moves: what the last
   plausible errors asked for is held, and ANHYST_SAMPLE_IMPLAUSIBLE is set. So wrong readings wind
   up no integral, however long they last; how many are too many is the caller's to judge.

   A drive whose current stays off what was commanded is lost: none is commanded any more, and the
   others share out without it. What the body goes on without was found beforehand; without any
   other, or two of them, it lands. A head is lost that says no number, jumps or stands still: the
   body lands by the others if they still tell the pose, else nothing is driven from then on.

   It flies from the first tick on. Of the commands of states.h IDLE lets it go at once; LIFT takes
   it from rest where it is seen to the target, each axis at a limited speed, and is refused where
   anything is lost; LAND moves what is aimed at down until the body lies. Others are refused.

   Heads are counted from what they would read at the target: single precision resolves a nanometre
   over 8 mm only, so integers or doubles are subtracted before they are rounded. Declarations are
   in generic/axes.h. */
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
#define ANHYST_AXES_ODD 8U /* how much more doubt there is about a head that jumps */

typedef enum {
  ANHYST_AXES_FLY,
  ANHYST_AXES_LAND,
  ANHYST_AXES_REST,
  ANHYST_AXES_LIFT
} anhyst_axes_state;

/* A matrix row by row, and the PID of an axis: in fixed point they are more, see axes_fixed.h. */
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
