/* SPDX-License-Identifier: Apache-2.0 */

/* Settings; constant. Matrices are stored by rows. */
typedef struct {
  anhyst_wrench_layout_x layout;
  uint16_t heads;
  anhyst_rows_x see;            /* pose from head readings: a row for each axis, m or rad per m */
  anhyst_rows_x decouple;       /* square matrix, one row for each axis */
  anhyst_rows_x weigh;          /* square matrix of masses, kg, and moments of inertia, kg m^2 */
  const anhyst_axis_pid_x *pid; /* PID controller of each axis: from error to acceleration */
  const ANHYST_REAL *reach;     /* largest plausible error of each axis, > 0 */
  ANHYST_REAL current_low;      /* lowest and highest input of the amplifiers, A */
  ANHYST_REAL current_high;
  ANHYST_REAL current_step; /* step of the D/A converters, A, > 0 */
  /* Detection of lost drives, and the reaction to a loss. */
  ANHYST_REAL follow; /* fraction of a current step that is reached one tick later, 0..1 */
  ANHYST_REAL slew;   /* slowest change of a current per tick after a step, A */
  ANHYST_REAL off;    /* smallest current deviation of a lost drive, A; 0: no detection */
  uint16_t off_ticks; /* consecutive ticks with this deviation before a drive counts as lost, > 0 */
  uint16_t spare;     /* bit mask of drives; the body can continue without one of them */
  uint16_t land_ticks;     /* duration of a landing, ticks */
  const ANHYST_REAL *land; /* change of the reference of each axis per tick of a landing */
  const ANHYST_REAL *lift; /* largest change of the reference of each axis per tick of a lift-off */
  /* Detection of lost heads, and the reaction to a loss. */
  anhyst_rows_x without; /* a matrix for each lost head, as `see`, with zeros in its column */
  uint16_t spare_heads;  /* bit mask of heads; without one of them, the others give the pose */
  ANHYST_REAL jump;      /* largest plausible change of a reading per tick, m; 0: no detection */
  uint16_t doubt;        /* count at which a head is lost, > 0; no change in a tick adds 1, a jump
                            or NaN adds ANHYST_AXES_ODD */
  uint16_t noisy;        /* whether the noise of the heads always changes the readings */
  const uint16_t *axis;  /* for heads fixed to the ground, which see other points of the body as it
                            moves: number 0..5 of each axis (along x, y, z, about x, y, z);
                            otherwise, and in fixed point, NULL */
} anhyst_axes_settings_x;

/* Inputs of one tick. */
typedef struct {
  const ANHYST_REAL *head;    /* reading of each head minus its reading at the target, m */
  const ANHYST_REAL *forward; /* feedforward wrench, including the weight of the body */
  const ANHYST_REAL *gap;     /* gap of each drive, m */
  const ANHYST_REAL *flux;    /* flux density in each drive, T; NaN without a probe */
  const ANHYST_REAL *current; /* current of each drive, A; NaN: not measured */
  uint16_t command;
  const ANHYST_REAL *target; /* target of each axis, m and rad; for heads fixed to the ground */
} anhyst_axes_sample_x;

/* Results of one tick. */
typedef struct {
  ANHYST_REAL *current; /* current of each drive, A */
  ANHYST_REAL *demand;  /* demanded wrench */
  uint16_t flags;       /* flags of flags.h, combined by OR over the drives */
  uint32_t lost;        /* bit mask of the lost drives; from bit 16 on, of the lost heads */
  uint16_t state;       /* value of anhyst_axes_state */
} anhyst_axes_answer_x;

typedef struct {
  const anhyst_axes_settings_x *settings;
  anhyst_force_controller_x *const *drive;
  anhyst_wrench_x allocator;
  anhyst_axis_pid_state_x pid_state[ANHYST_WRENCH_AXES];
  ANHYST_REAL acceleration[ANHYST_WRENCH_AXES]; /* accelerations for the last plausible errors */
  ANHYST_REAL commanded_current[ANHYST_WRENCH_DRIVES]; /* commanded currents, A */
  ANHYST_REAL expected_current[ANHYST_WRENCH_DRIVES];  /* currents expected to flow, A */
  uint16_t deviating_ticks[ANHYST_WRENCH_DRIVES];      /* consecutive ticks with a deviation */
  ANHYST_REAL reference_offset[ANHYST_WRENCH_AXES];    /* reference minus target, for each axis */
  ANHYST_REAL last_reading[ANHYST_AXES_HEADS];         /* last accepted reading of each head */
  uint16_t doubt_count[ANHYST_AXES_HEADS]; /* count of suspect readings, a jump counts more */
  uint16_t valid_heads;                    /* bit mask of the heads that had a valid reading */
  uint16_t lost_heads;                     /* bit mask of the lost heads */
  uint16_t last_lost_head;                 /* index of the last lost head */
  uint16_t landing_ticks;                  /* number of ticks since the landing started */
  uint16_t flight_state;                   /* value of anhyst_axes_state */
} anhyst_axes_x;

/* Starts at standstill. Returns ANHYST_OK, or ANHYST_BAD_PARAMETER if the settings are not valid.
   The structures behind the pointers must live as long as the controller. */
anhyst_status anhyst_axes_init_x(anhyst_axes_x *c, const anhyst_axes_settings_x *settings,
                                 anhyst_force_controller_x *const *drive);

/* Executes one tick. The currents stay within the limits for any sample. */
void anhyst_axes_tick_x(anhyst_axes_x *c, const anhyst_axes_sample_x *sample,
                        anhyst_axes_answer_x *out);
