/* SPDX-License-Identifier: Apache-2.0 */

/* Limits of the amplifiers: constants of a board, which no exchange can change. */
typedef struct {
  anhyst_levitation_limits levitation; /* q31 of the position's full scale */
  ANHYST_REAL current_low;
  ANHYST_REAL current_high; /* above low by an integer number of steps */
  ANHYST_REAL current_step; /* step of the converter, > 0: currents are low, low + step, ... */
  ANHYST_REAL release;      /* change per tick, at least one step: of a current on its ramp to zero,
                               and of the fading jump after a swap or a switch */
} anhyst_position_limits_x;

/* Settings of the position control. */
typedef struct {
  anhyst_levitation_settings levitation; /* q31 of the full scales of position and demand */
  anhyst_pidd2_gains_x gains;
  anhyst_position_units_x units;
  ANHYST_REAL bias;          /* force of each magnet of a pair without a net force */
  uint16_t measured;         /* whether measured currents count as applied */
  const anhyst_map_x *plain; /* map for operation without compensation; 0: none */
} anhyst_position_settings_x;

/* Inputs of one tick. */
typedef struct {
  ANHYST_REAL position;                         /* of the armature; rises when the armature rises */
  ANHYST_REAL target;                           /* of the position */
  ANHYST_REAL load;                             /* feedforward load */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* measured */
  ANHYST_REAL
  flux[ANHYST_POSITION_MAGNETS]; /* measured flux density, or none: see force_controller.h */
  uint16_t dropped;              /* whether the position is missing */
  uint16_t command;              /* executed first; see states.h */
} anhyst_position_sample_x;

/* Results of one tick. */
typedef struct {
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* to drive; 0 for a missing magnet */
  ANHYST_REAL reference;                        /* present reference of the position */
  ANHYST_REAL demand;                           /* demanded net force */
  uint16_t state;                               /* 16*state + phase, see states.h */
  uint16_t flags;                               /* see flags.h; combined by OR over the magnets */
} anhyst_position_answer_x;

/* A controller. */
typedef struct {
  const anhyst_position_limits_x *limits;
  const anhyst_position_settings_x *settings;
  anhyst_force_controller_x *magnet[ANHYST_POSITION_MAGNETS]; /* second: 0 without a pair */
  anhyst_levitation levitation;
  anhyst_pidd2_state_x state;
  anhyst_pidd2_candidate_x candidate;
  ANHYST_REAL position;                         /* last plausible position */
  ANHYST_REAL gap[ANHYST_POSITION_MAGNETS];     /* at this position */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* driven */
  ANHYST_REAL fading[ANHYST_POSITION_MAGNETS];  /* fading jump, added to the demanded current */
  ANHYST_REAL demand;                           /* demanded net force */
  uint16_t flags;                               /* of this tick */
  uint16_t limited;                             /* whether the driven currents are limited */
  uint16_t pending;                             /* whether the candidate needs a commit */
} anhyst_position_x;

/* Starts in the state init, without current. magnet_2 is 0 for a single magnet. Returns ANHYST_OK,
   or ANHYST_BAD_PARAMETER, without a change, if limits or settings are not valid. The structures
   behind the pointers must live as long as the controller. */
anhyst_status anhyst_position_init_x(anhyst_position_x *c, const anhyst_position_limits_x *limits,
                                     const anhyst_position_settings_x *settings,
                                     anhyst_force_controller_x *magnet,
                                     anhyst_force_controller_x *magnet_2);

/* Executes a command between two ticks, or returns why not: ANHYST_REFUSED_... of supervisor.h. */
uint16_t anhyst_position_command_x(anhyst_position_x *c, uint16_t command);

/* Executes one tick. The currents stay within the limits for any sample. */
void anhyst_position_tick_x(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                            anhyst_position_answer_x *out);
