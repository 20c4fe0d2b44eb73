/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of axes.h in fixed point. All inputs and outputs are integers, and no calculation
   uses floating point.

   Every quantity is a q31 code of its own full scale: head readings, each coordinate of the pose,
   each acceleration, each component of the wrench, force and current of the force controllers, and
   the range of the gap. Matrix rows with a shift (wide.h) convert one quantity to another. A sum
   has 64 bits, is rounded to nearest once, and saturates. A missing head reading or current is
   ANHYST_Q31_MIN, a missing flux density ANHYST_NO_FLUX.

   The PID controller of an axis is stored as partial fractions. The controller has second order
   with one pole at zero frequency:

     demand   = direct*e + sum + lag
     sum'     = sum + summed*e                 exactly; limited to full scale of the acceleration
     lag'     = lag - decay*lag + lagging*e    limited to 2^60

   sum and lag have `shift` more bits than the acceleration, so that they do not drift at
   standstill. The demand saturates at full scale. The error of one step against exact arithmetic
   with the same numbers is half an LSB of the acceleration, plus 2^(29 - shift) LSB in the lag. */
#ifndef ANHYST_AXES_FIXED_H
#define ANHYST_AXES_FIXED_H

#include "anhyst/compensator/force_controller.h"
#include "anhyst/control/axes.h"
#include "anhyst/control/wrench_fixed.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ANHYST_AXIS_PID_MOST ((int32_t)536870912) /* 2^29, largest |coefficient| */
#define ANHYST_AXIS_PID_SHIFT 29U

/* Coefficients of the error e, divided by 2^shift. */
typedef struct {
  int32_t direct;
  int32_t summed;
  int32_t lagging;
  int32_t decay;  /* fraction of the lag that decays per tick, q30, > 0 */
  uint16_t shift; /* exponent of the divisor, 0..ANHYST_AXIS_PID_SHIFT */
} anhyst_axis_pid_q31;

/* State of the PID controller; zero is standstill. Any number is valid and is limited. */
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
