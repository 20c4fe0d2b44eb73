/* SPDX-License-Identifier: Apache-2.0 */

/* What the amplifiers accept. Constants of a board, outside anything that can be exchanged. */
typedef struct {
  anhyst_levitation_limits levitation; /* q31 of the position's full scale */
  ANHYST_REAL current_low;
  ANHYST_REAL current_high; /* above low by a whole number of steps */
  ANHYST_REAL current_step; /* of the converter, > 0: currents are low, low + step, ... */
  ANHYST_REAL release;      /* change a tick, >= a step: of a current that is to go to zero, and of
                               what a swap or a switch leaves of the current before it */
} anhyst_position_limits_x;

/* How the position is controlled. */
typedef struct {
  anhyst_levitation_settings levitation; /* q31 of the full scales of position and demand */
  anhyst_pidd2_gains_x gains;
  anhyst_position_units_x units;
  ANHYST_REAL bias;          /* force of either magnet of a pair when the net force is zero */
  uint16_t measured;         /* whether currents count as applied as they were measured */
  const anhyst_map_x *plain; /* drives while nothing is compensated; 0: there is none */
} anhyst_position_settings_x;

/* What is known at one tick. */
typedef struct {
  ANHYST_REAL position;                         /* of the armature, rising as it rises */
  ANHYST_REAL target;                           /* wanted */
  ANHYST_REAL load;                             /* that is fed forward */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* measured */
  ANHYST_REAL
  flux[ANHYST_POSITION_MAGNETS]; /* density, measured, or none: see force_controller.h */
  uint16_t dropped;              /* whether there is no position */
  uint16_t command;              /* done first; see states.h */
} anhyst_position_sample_x;

/* What follows. */
typedef struct {
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* to drive; 0 for a magnet that is not there */
  ANHYST_REAL reference;                        /* position now controlled to */
  ANHYST_REAL demand;                           /* wanted net force */
  uint16_t state;                               /* 16*state + phase, see states.h */
  uint16_t flags;                               /* see flags.h, or-ed over the magnets */
} anhyst_position_answer_x;

/* One controller. */
typedef struct {
  const anhyst_position_limits_x *limits;
  const anhyst_position_settings_x *settings;
  anhyst_force_controller_x *magnet[ANHYST_POSITION_MAGNETS]; /* the second: 0 without a pair */
  anhyst_levitation levitation;
  anhyst_pidd2_state_x state;
  anhyst_pidd2_candidate_x candidate;
  ANHYST_REAL position;                         /* the last plausible one */
  ANHYST_REAL gap[ANHYST_POSITION_MAGNETS];     /* that belongs to it */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* driven */
  ANHYST_REAL fading[ANHYST_POSITION_MAGNETS];  /* driven beside what is wanted */
  ANHYST_REAL demand;                           /* wanted net force */
  uint16_t flags;                               /* of this tick */
  uint16_t limited;                             /* whether it drives less than it wants */
  uint16_t pending;                             /* whether the candidate is to be committed */
} anhyst_position_x;

/* Starts in init, without current. magnet_2 is 0 for a single magnet. ANHYST_OK, or
   ANHYST_BAD_PARAMETER where limits or settings are not valid; nothing is changed then. What is
   pointed to must live as long as the controller. */
anhyst_status anhyst_position_init_x(anhyst_position_x *c, const anhyst_position_limits_x *limits,
                                     const anhyst_position_settings_x *settings,
                                     anhyst_force_controller_x *magnet,
                                     anhyst_force_controller_x *magnet_2);

/* Does a command between two ticks, or says why it cannot: ANHYST_REFUSED_... of supervisor.h. */
uint16_t anhyst_position_command_x(anhyst_position_x *c, uint16_t command);

/* One tick. The currents stay within the limits whatever the sample says. */
void anhyst_position_tick_x(anhyst_position_x *c, const anhyst_position_sample_x *sample,
                            anhyst_position_answer_x *out);
