/* SPDX-License-Identifier: Apache-2.0 */

/* Settings; constant. Matrices are stored by rows. */
typedef struct {
  anhyst_wrench_layout_x layout;
  uint16_t heads;
  anhyst_rows_x see;            /* pose (m and rad) from head readings (m): axes rows of heads */
  anhyst_rows_x decouple;       /* axes rows of axes numbers */
  anhyst_rows_x weigh;          /* N and N m per m/s^2 and rad/s^2: axes rows of axes numbers */
  const anhyst_axis_pid_x *pid; /* of each axis: error to acceleration */
  const ANHYST_REAL *reach;     /* of each axis: largest plausible error, > 0 */
  ANHYST_REAL current_low;      /* limits of the amplifiers' input, A */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* step of their converters, A, > 0 */
  /* Detection of lost drives, and the reaction. */
  ANHYST_REAL follow;  /* part of a current step that has flowed one tick later, 0..1 */
  ANHYST_REAL slew;    /* minimum change of a current per tick after a step, A */
  ANHYST_REAL off;     /* minimum deviation of the current of a lost drive, A; 0: no detection */
  uint16_t off_ticks;  /* consecutive ticks with this deviation, > 0 */
  uint16_t spare;      /* drives without one of which the body can continue, bit mask */
  uint16_t land_ticks; /* duration of a landing, ticks */
  const ANHYST_REAL *land; /* of each axis: change of the reference per tick of a landing */
  const ANHYST_REAL *lift; /* of each axis: maximum change of the reference per tick of lift-off */
  /* Detection of lost heads, and the reaction. */
  anhyst_rows_x without; /* `see` without each head in turn, whose own column is zero */
  uint16_t spare_heads;  /* heads without one of which the others give the pose, bit mask */
  ANHYST_REAL jump;      /* maximum change of a reading per tick, m; 0: no detection */
  uint16_t doubt;        /* doubt at which a head is lost, > 0. Increases by 1 per tick without a
                            change, and by ANHYST_AXES_ODD per tick with a jump or NaN */
  uint16_t noisy;        /* whether noise always changes the readings */
  const uint16_t *axis;  /* number 0..5 of each axis (along x, y, z, about x, y, z), if the heads
                            are fixed to the ground and see other points of the body as it moves;
                            otherwise NULL; always NULL in fixed point */
} anhyst_axes_settings_x;

/* Inputs of one tick. */
typedef struct {
  const ANHYST_REAL *head;    /* reading of each head minus its reading at the target, m */
  const ANHYST_REAL *forward; /* feedforward wrench, including the weight */
  const ANHYST_REAL *gap;     /* of each drive, m */
  const ANHYST_REAL *flux;    /* flux density in each drive, T; NAN without a probe */
  const ANHYST_REAL *current; /* of each drive, A; NaN: not measured */
  uint16_t command;
  const ANHYST_REAL *target; /* of each axis, m and rad; required for heads on the ground */
} anhyst_axes_sample_x;

/* Results of one tick. */
typedef struct {
  ANHYST_REAL *current; /* of each drive, A */
  ANHYST_REAL *demand;  /* demanded wrench */
  uint16_t flags;       /* see flags.h; combined by OR over the drives */
  uint32_t lost;        /* lost drives, bit mask; lost heads from bit 16 on */
  uint16_t state;       /* anhyst_axes_state */
} anhyst_axes_answer_x;

typedef struct {
  const anhyst_axes_settings_x *settings;
  anhyst_force_controller_x *const *drive;
  anhyst_wrench_x share;
  anhyst_axis_pid_state_x state[ANHYST_WRENCH_AXES];
  ANHYST_REAL asked[ANHYST_WRENCH_AXES];       /* accelerations for the last plausible errors */
  ANHYST_REAL commanded[ANHYST_WRENCH_DRIVES]; /* commanded currents */
  ANHYST_REAL due[ANHYST_WRENCH_DRIVES];       /* currents that are expected to flow */
  uint16_t wrong[ANHYST_WRENCH_DRIVES];        /* consecutive ticks with a deviation */
  ANHYST_REAL away[ANHYST_WRENCH_AXES];        /* reference minus target */
  ANHYST_REAL seen[ANHYST_AXES_HEADS];         /* last accepted reading of each head */
  uint16_t doubt[ANHYST_AXES_HEADS];           /* about each head */
  uint16_t sighted;                            /* heads with at least one valid reading, bit mask */
  uint16_t blind;                              /* lost heads, bit mask */
  uint16_t gone;                               /* the last lost head */
  uint16_t landing;                            /* ticks of the landing so far */
  uint16_t flight;                             /* anhyst_axes_state */
} anhyst_axes_x;

/* Starts at rest. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if the settings are not valid. The
   structures behind the pointers must live as long as the controller. */
anhyst_status anhyst_axes_init_x(anhyst_axes_x *c, const anhyst_axes_settings_x *settings,
                                 anhyst_force_controller_x *const *drive);

/* Executes one tick. The currents stay within the limits for any sample. */
void anhyst_axes_tick_x(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                        anhyst_axes_answer_x *out);
