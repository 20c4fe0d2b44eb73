/* SPDX-License-Identifier: Apache-2.0 */

/* Constant; matrices row by row. */
typedef struct {
  ANHYST_NAME(anhyst_wrench_layout) layout;
  uint16_t heads;
  const ANHYST_REAL *see;      /* axes rows of heads: pose, m and rad, of what the heads read, m */
  const ANHYST_REAL *decouple; /* axes rows of axes */
  const ANHYST_REAL *weigh;    /* axes rows of axes: N and N m of m/s^2 and rad/s^2 */
  const ANHYST_NAME(anhyst_biquad) *pid; /* of each axis: error to acceleration */
  const ANHYST_REAL *reach;              /* of each: largest plausible error, > 0 */
  ANHYST_REAL current_low;               /* of what the amplifiers accept, A */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* of their converters, > 0 */
} ANHYST_NAME(anhyst_axes_settings);

/* What is known at one tick. */
typedef struct {
  const ANHYST_REAL *head;    /* readings of the position heads, m */
  const ANHYST_REAL *target;  /* wanted pose */
  const ANHYST_REAL *forward; /* wrench that is fed forward, the weight in it */
  const ANHYST_REAL *gap;     /* of each drive, m */
  const ANHYST_REAL *flux;    /* density in each, T; NAN without a probe */
} ANHYST_NAME(anhyst_axes_sample);

/* What follows. */
typedef struct {
  ANHYST_REAL *current; /* of each drive, A */
  ANHYST_REAL *demand;  /* wanted wrench */
  uint16_t flags;       /* see flags.h, or-ed over the drives */
} ANHYST_NAME(anhyst_axes_answer);

typedef struct {
  const ANHYST_NAME(anhyst_axes_settings) *settings;
  ANHYST_NAME(anhyst_force_controller) *const *drive;
  ANHYST_NAME(anhyst_wrench) share;
  ANHYST_NAME(anhyst_biquad_state) state[ANHYST_WRENCH_AXES];
  ANHYST_REAL asked[ANHYST_WRENCH_AXES]; /* accelerations of the last plausible errors */
} ANHYST_NAME(anhyst_axes);

/* Starts at rest. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not valid; what is pointed
   to must live as long as the controller. */
anhyst_status ANHYST_NAME(anhyst_axes_init)(ANHYST_NAME(anhyst_axes) *c,
                                            const ANHYST_NAME(anhyst_axes_settings) *settings,
                                            ANHYST_NAME(anhyst_force_controller) *const *drive);

/* One tick. The currents stay within the limits whatever the sample says. */
void ANHYST_NAME(anhyst_axes_tick)(ANHYST_NAME(anhyst_axes) *c,
                                   const ANHYST_NAME(anhyst_axes_sample) *sample,
                                   ANHYST_NAME(anhyst_axes_answer) *out);
