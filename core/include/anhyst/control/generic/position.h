/* SPDX-License-Identifier: Apache-2.0 */

/* What the amplifiers accept. Constants of a board, outside anything that can be exchanged. */
typedef struct {
  anhyst_levitation_limits levitation; /* q31 of the position's full scale */
  ANHYST_REAL current_low;
  ANHYST_REAL current_high; /* above low by a whole number of steps */
  ANHYST_REAL current_step; /* of the converter, > 0: currents are low, low + step, ... */
  ANHYST_REAL release;      /* change a tick, >= a step: of a current that is to go to zero, and of
                               what a swap or a switch leaves of the current before it */
} ANHYST_NAME(anhyst_position_limits);

/* How the position is controlled. */
typedef struct {
  anhyst_levitation_settings levitation; /* q31 of the full scales of position and demand */
  ANHYST_NAME(anhyst_pidd2_gains) gains;
  ANHYST_NAME(anhyst_position_units) units;
  ANHYST_REAL bias;  /* force of either magnet of a pair when the net force is zero */
  uint16_t measured; /* whether currents count as applied as they were measured */
  const ANHYST_NAME(anhyst_map) *plain; /* drives while nothing is compensated; 0: there is none */
} ANHYST_NAME(anhyst_position_settings);

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
} ANHYST_NAME(anhyst_position_sample);

/* What follows. */
typedef struct {
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* to drive; 0 for a magnet that is not there */
  ANHYST_REAL reference;                        /* position now controlled to */
  ANHYST_REAL demand;                           /* wanted net force */
  uint16_t state;                               /* 16*state + phase, see states.h */
  uint16_t flags;                               /* see flags.h, or-ed over the magnets */
} ANHYST_NAME(anhyst_position_answer);

/* One controller. */
typedef struct {
  const ANHYST_NAME(anhyst_position_limits) *limits;
  const ANHYST_NAME(anhyst_position_settings) *settings;
  ANHYST_NAME(anhyst_force_controller)
  *magnet[ANHYST_POSITION_MAGNETS]; /* the second: 0 without a pair */
  anhyst_levitation levitation;
  ANHYST_NAME(anhyst_pidd2_state) state;
  ANHYST_NAME(anhyst_pidd2_candidate) candidate;
  ANHYST_REAL position;                         /* the last plausible one */
  ANHYST_REAL gap[ANHYST_POSITION_MAGNETS];     /* that belongs to it */
  ANHYST_REAL current[ANHYST_POSITION_MAGNETS]; /* driven */
  ANHYST_REAL fading[ANHYST_POSITION_MAGNETS];  /* driven beside what is wanted */
  ANHYST_REAL demand;                           /* wanted net force */
  uint16_t flags;                               /* of this tick */
  uint16_t limited;                             /* whether it drives less than it wants */
  uint16_t pending;                             /* whether the candidate is to be committed */
} ANHYST_NAME(anhyst_position);

/* Starts in init, without current. magnet_2 is 0 for a single magnet. ANHYST_OK, or
   ANHYST_BAD_PARAMETER where limits or settings are not valid; nothing is changed then. What is
   pointed to must live as long as the controller. */
anhyst_status ANHYST_NAME(anhyst_position_init)(
    ANHYST_NAME(anhyst_position) *c, const ANHYST_NAME(anhyst_position_limits) *limits,
    const ANHYST_NAME(anhyst_position_settings) *settings,
    ANHYST_NAME(anhyst_force_controller) *magnet, ANHYST_NAME(anhyst_force_controller) *magnet_2);

/* Does a command between two ticks, or says why it cannot: ANHYST_REFUSED_... of supervisor.h. */
uint16_t ANHYST_NAME(anhyst_position_command)(ANHYST_NAME(anhyst_position) *c, uint16_t command);

/* One tick. The currents stay within the limits whatever the sample says. */
void ANHYST_NAME(anhyst_position_tick)(ANHYST_NAME(anhyst_position) *c,
                                       const ANHYST_NAME(anhyst_position_sample) *sample,
                                       ANHYST_NAME(anhyst_position_answer) *out);
