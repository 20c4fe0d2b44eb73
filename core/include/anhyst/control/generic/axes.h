/* SPDX-License-Identifier: Apache-2.0 */

/* Constant; matrices row by row. */
typedef struct {
  anhyst_wrench_layout_x layout;
  uint16_t heads;
  anhyst_rows_x see;            /* axes rows of heads: pose, m and rad, of what they read, m */
  anhyst_rows_x decouple;       /* axes rows of axes */
  anhyst_rows_x weigh;          /* axes rows of axes: N and N m of m/s^2 and rad/s^2 */
  const anhyst_axis_pid_x *pid; /* of each axis: error to acceleration */
  const ANHYST_REAL *reach;     /* of each: largest plausible error, > 0 */
  ANHYST_REAL current_low;      /* of what the amplifiers accept, A */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* of their converters, > 0 */
  /* What is done about drives that are lost. */
  ANHYST_REAL follow;  /* part of a step of current that has flowed a tick later, 0..1 */
  ANHYST_REAL slew;    /* by which a current at least moves in a tick if it has to, A */
  ANHYST_REAL off;     /* by which the current of one is off at least, A; 0: none is looked at */
  uint16_t off_ticks;  /* for so many ticks on end, > 0 */
  uint16_t spare;      /* those without one of which the body goes on, bit by bit */
  uint16_t land_ticks; /* which a landing takes */
  const ANHYST_REAL *land; /* of each axis, by what is aimed at moves in a tick of it */
  const ANHYST_REAL *lift; /* the same in a tick of lift-off, at most */
  /* And about heads. */
  anhyst_rows_x without; /* see without each of them in its place, its own column zero */
  uint16_t spare_heads;  /* without one of which the others tell the pose, bit by bit */
  ANHYST_REAL jump;      /* by which one moves in a tick at most, m; 0: none is looked at */
  uint16_t doubt;        /* with which one is lost, > 0: 1 a tick in which it stood still,
                            ANHYST_AXES_ODD one in which it jumped or said no number */
  uint16_t noisy;        /* whether none stands still by itself */
  const uint16_t *axis;  /* of each axis 0..5, along or about x, y, z, where heads stand on the
                            ground and see other places of the body as that goes on; else NULL;
                            always NULL in fixed point */
} anhyst_axes_settings_x;

/* What is known at one tick. */
typedef struct {
  const ANHYST_REAL *head;    /* of each, less what it would read at the target, m */
  const ANHYST_REAL *forward; /* wrench that is fed forward, the weight in it */
  const ANHYST_REAL *gap;     /* of each drive, m */
  const ANHYST_REAL *flux;    /* density in each, T; NAN without a probe */
  const ANHYST_REAL *current; /* in each, A; what is no number says nothing */
  uint16_t command;
  const ANHYST_REAL *target; /* of each axis, m and rad; asked for where heads stand */
} anhyst_axes_sample_x;

/* What follows. */
typedef struct {
  ANHYST_REAL *current; /* of each drive, A */
  ANHYST_REAL *demand;  /* wanted wrench */
  uint16_t flags;       /* see flags.h, or-ed over the drives */
  uint32_t lost;        /* drives, bit by bit; from bit 16 on heads */
  uint16_t state;       /* anhyst_axes_state */
} anhyst_axes_answer_x;

typedef struct {
  const anhyst_axes_settings_x *settings;
  anhyst_force_controller_x *const *drive;
  anhyst_wrench_x share;
  anhyst_axis_pid_state_x state[ANHYST_WRENCH_AXES];
  ANHYST_REAL asked[ANHYST_WRENCH_AXES];       /* accelerations of the last plausible errors */
  ANHYST_REAL commanded[ANHYST_WRENCH_DRIVES]; /* currents */
  ANHYST_REAL due[ANHYST_WRENCH_DRIVES];       /* those that should flow */
  uint16_t wrong[ANHYST_WRENCH_DRIVES];        /* ticks for which others did */
  ANHYST_REAL away[ANHYST_WRENCH_AXES];        /* what is aimed at less the target */
  ANHYST_REAL seen[ANHYST_AXES_HEADS];         /* last of each head */
  uint16_t doubt[ANHYST_AXES_HEADS];           /* about each */
  uint16_t sighted;                            /* heads that said a number so far, bit by bit */
  uint16_t blind;                              /* heads that are lost */
  uint16_t gone;                               /* the last of them */
  uint16_t landing;                            /* ticks of it so far */
  uint16_t flight;                             /* anhyst_axes_state */
} anhyst_axes_x;

/* Starts at rest. ANHYST_OK, or ANHYST_BAD_PARAMETER where settings are not valid; what is pointed
   to must live as long as the controller. */
anhyst_status anhyst_axes_init_x(anhyst_axes_x *c, const anhyst_axes_settings_x *settings,
                                 anhyst_force_controller_x *const *drive);

/* One tick. The currents stay within the limits whatever the sample says. */
void anhyst_axes_tick_x(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                        anhyst_axes_answer_x *out);
