/* SPDX-License-Identifier: Apache-2.0 */
/* The controller of a body of one to six coordinates on any number of drives, in double precision:
   position heads in, currents out.

     pose    = see*heads
     error   = decouple*(target - pose)
     wrench  = weigh*PID(error) + forward
     force   = wrench shared out, see wrench.h
     current = what each drive's force controller makes of it, limited, on the converter's grid

   With decouple taking errors to the centre of mass and weigh the masses about it, every PID sees a
   mass of one and no axis pushes another. The PIDs are filters of second order, as in
   tracking_real.h. What is applied is committed to the force controllers at once. */
#ifndef ANHYST_AXES_H
#define ANHYST_AXES_H

#include "anhyst/compensator/force_controller_real.h"
#include "anhyst/control/biquad_real.h"
#include "anhyst/control/wrench.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Constant; matrices row by row. */
typedef struct {
  anhyst_wrench_layout layout;
  uint16_t heads;
  const double *see;            /* axes rows of heads: pose, m and rad, of what the heads read, m */
  const double *decouple;       /* axes rows of axes */
  const double *weigh;          /* axes rows of axes: N and N m of m/s^2 and rad/s^2 */
  const anhyst_biquad_f64 *pid; /* of each axis: error to acceleration */
  double current_low;           /* of what the amplifiers accept, A */
  double current_high;
  double current_step; /* of their converters, > 0 */
} anhyst_axes_settings;

/* What is known at one tick. */
typedef struct {
  const double *head;    /* readings of the position heads, m */
  const double *target;  /* wanted pose */
  const double *forward; /* wrench that is fed forward, the weight in it */
  const double *gap;     /* of each drive, m */
  const double *flux;    /* density in each, T; NAN without a probe */
} anhyst_axes_sample;

/* What follows. */
typedef struct {
  double *current; /* of each drive, A */
  double *demand;  /* wanted wrench */
  uint16_t flags;  /* see flags.h, or-ed over the drives */
} anhyst_axes_answer;

typedef struct {
  const anhyst_axes_settings *settings;
  anhyst_force_controller_f64 *const *drive;
  anhyst_biquad_state_f64 state[ANHYST_WRENCH_AXES];
} anhyst_axes;

/* Starts at rest. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not valid; what is pointed
   to must live as long as the controller. */
anhyst_status anhyst_axes_init(anhyst_axes *c, const anhyst_axes_settings *settings,
                               anhyst_force_controller_f64 *const *drive);

/* One tick. The currents stay within the limits whatever the sample says. */
void anhyst_axes_tick(anhyst_axes *c, const anhyst_axes_sample *sample, anhyst_axes_answer *out);

#ifdef __cplusplus
}
#endif
#endif
