/* SPDX-License-Identifier: Apache-2.0 */

/* Limits of the amplifiers: constants of a board, which no parameter block changes. */
typedef struct {
  anhyst_levitation_limits levitation; /* limits of the position, q31 of its full scale */
  ANHYST_REAL current_low;
  ANHYST_REAL current_high; /* highest current: current_low plus an integer number of steps */
  ANHYST_REAL current_step; /* step of the D/A converter, > 0: currents are low, low + step, ... */
  ANHYST_REAL release;      /* change per tick of a ramp to zero and of a fading jump, >= 1 step */
} anhyst_position_limits_x;

/* Settings of the position control. */
typedef struct {
  anhyst_levitation_settings levitation; /* q31 of the full scales of position and demand */
  anhyst_pidd2_gains_x gains;
  anhyst_position_units_x units;
  ANHYST_REAL bias;          /* force of each magnet of a pair without a net force */
  uint16_t measured;         /* whether the measured currents count as applied */
  const anhyst_map_x *plain; /* map for operation without compensation; null: there is none */
} anhyst_position_settings_x;

/* Inputs of one tick. */
typedef struct {
  ANHYST_REAL position;                         /* upward position of the armature */
  ANHYST_REAL target;                           /* target of the position */
  ANHYST_REAL load;                             /* feedforward load */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* measured current of each magnet */
  ANHYST_REAL
  flux[ANHYST_POSITION_MAGNETS]; /* flux density of each magnet, or the value for no sample */
  uint16_t dropped;              /* whether the position is missing */
  uint16_t command;              /* command, executed before the tick; see states.h */
} anhyst_position_sample_x;

/* Results of one tick. */
typedef struct {
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* current of each magnet; 0 for a missing magnet */
  ANHYST_REAL reference;                        /* present reference of the position */
  ANHYST_REAL demand;                           /* demanded net force */
  uint16_t state;                               /* 16*state + phase, see states.h */
  uint16_t flags;                               /* flags (flags.h) of all magnets */
} anhyst_position_answer_x;

/* A controller. */
typedef struct {
  const anhyst_position_limits_x *limits;
  const anhyst_position_settings_x *settings;
  anhyst_force_controller_x *magnet[ANHYST_POSITION_MAGNETS]; /* second: null without a pair */
  anhyst_levitation levitation;
  anhyst_pidd2_state_x state;
  anhyst_pidd2_candidate_x candidate;
  ANHYST_REAL position;                         /* last plausible position */
  ANHYST_REAL gap[ANHYST_POSITION_MAGNETS];     /* gap of each magnet at this time */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* driven current of each magnet */
  ANHYST_REAL fading[ANHYST_POSITION_MAGNETS];  /* fading jump of the current */
  ANHYST_REAL demand;                           /* demanded net force */
  uint16_t flags;                               /* flags of this tick */
  uint16_t limited;                             /* whether the driven currents are limited */
  uint16_t pending;                             /* whether the candidate needs a commit */
} anhyst_position_x;

/* Starts in the state INIT, without current. magnet_2 is null for a single magnet. Returns
   ANHYST_OK, or ANHYST_BAD_PARAMETER if limits or settings are not valid; then *c is unchanged. The
   structures behind the pointers must live as long as the controller. */
anhyst_status anhyst_position_init_x(anhyst_position_x *c, const anhyst_position_limits_x *limits,
                                     const anhyst_position_settings_x *settings,
                                     anhyst_force_controller_x *magnet,
                                     anhyst_force_controller_x *magnet_2);

/* Executes a command between two ticks. Returns ANHYST_REFUSED_... of supervisor.h. */
uint16_t anhyst_position_command_x(anhyst_position_x *c, uint16_t command);

/* Executes one tick. The currents stay within the limits for any sample. */
void anhyst_position_tick_x(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                            anhyst_position_answer_x *out);
