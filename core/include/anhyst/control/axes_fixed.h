/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of axes.h in fixed point: integers in, integers out, no floating point.

   Every quantity has a full scale of its own, which its codes (q31) are of: what heads read, each
   coordinate of the pose, each acceleration, each number of the wrench, force and current of the
   force controllers, the range of the gap. Rows of numbers with a shift (wide.h) take the codes of
   one to those of the other, are summed up in 64 bits, rounded to the nearest once, and saturate.

   A head or current that says nothing is ANHYST_Q31_MIN, a flux density ANHYST_NO_FLUX.

   The PID of an axis is its partial fractions, all of second order with one pole at rest:

     asked    = direct*e + sum + lag
     sum'     = sum + summed*e                 exactly; within full scale of the acceleration
     lag'     = lag - decay*lag + lagging*e    within 2^60

   Both states have `shift` more digits than the acceleration: nothing creeps, however long a body
   stands still. What is asked for saturates at full scale. Error of one step against exact
   arithmetic with the same numbers: half a unit of the acceleration, and 2^(29 - shift) of it in
   the lag. */
#ifndef ANHYST_AXES_FIXED_H
#define ANHYST_AXES_FIXED_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/control/axes.h"
#include "anhyst/control/wrench_fixed.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_AXIS_PID_MOST ((int32_t)536870912) /* 2^29, of the size of its numbers */
#define ANHYST_AXIS_PID_SHIFT 29U

/* Numbers of an error over 2^shift. */
typedef struct {
  int32_t direct;
  int32_t summed;
  int32_t lagging;
  int32_t decay;  /* of the lag in a tick, q30, > 0 */
  uint16_t shift; /* 0..ANHYST_AXIS_PID_SHIFT */
} anhyst_axis_pid_q31;

/* Zero is rest. Any numbers are a state: beyond their bounds they count as these. */
typedef struct {
  int64_t sum;
  int64_t lag;
} anhyst_axis_pid_state_q31;

#include "anhyst/numeric/q31.h"
#include "anhyst/control/generic/axes.h"
#include "anhyst/numeric/no_format.h"

#ifdef __cplusplus
}
#endif
#endif
