/* SPDX-License-Identifier: Apache-2.0 */
/* The sequence of a levitating actuator: lift-off, landing, and the reaction to a lost position.
   supervisor.h defines states, commands and faults. In the state RUN, and in the state FAULT until
   the armature is at rest, these phases follow one another:

     BREAKAWAY  The demanded force rises until the armature has moved by `detect` from its rest.
     RISE       Position control: the reference moves to the target at a limited speed.
     HOVER      Position control: the reference is the target, also if the target jumps.
     DESCEND    Position control: the reference moves to the rest position at a limited speed.
     SET_DOWN   The demanded force falls to `press`, so that the armature does not drop when the
                currents go to zero.
     FALL       The position is lost during levitation: the currents are reduced. If the position
                returns within `hold` ticks, the armature lands under position control.

   The rest position is the position of the armature before it was lifted. After a fault during
   levitation, the armature lands under position control if the position is known and the amplifiers
   follow. A position that jumped is not accepted again until the command CLEAR.

   All signals are integers, in every number format of the controller. Positions rise when the
   armature rises; they are q31 of a full scale of the caller. Demands are q31 of the full scale of
   the force. No function contains a loop. */
#ifndef ANHYST_LEVITATION_H
#define ANHYST_LEVITATION_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/status.h"
#include "anhyst/control/supervisor.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Plausibility limits of the position: constants of a board, which no parameter block changes. */
typedef struct {
  int32_t low; /* lowest plausible position, below `high` */
  int32_t high;
  int32_t step;                 /* largest plausible change per tick, > 0 */
  uint16_t max_missing_samples; /* maximum number of consecutive bad samples; each is replaced by
                                   the last plausible one */
  uint16_t hold;                /* number of ticks of FALL in which a position may return */
  uint16_t selftest;            /* number of consecutive plausible samples for the self-test, > 0 */
} anhyst_levitation_limits;

/* Settings of lift-off and landing. All settings except `press` are above 0; speeds are per
   tick. */
typedef struct {
  int32_t detect;   /* distance from the rest position that counts as lift-off */
  int32_t rise;     /* speed of the reference in the phase RISE */
  int32_t descend;  /* speed of the reference in the phase DESCEND */
  int32_t lift;     /* rate of the demand in the phase BREAKAWAY */
  int32_t set_down; /* rate of the demand in the phase SET_DOWN */
  int32_t most;     /* demand at which the lift-off fails */
  int32_t press;    /* demand at the end of SET_DOWN: 0, or negative for a pair of magnets */
} anhyst_levitation_settings;

/* Inputs of one tick. */
typedef struct {
  int32_t position;
  int32_t target;
  int32_t demand;       /* demand of the controller in the last tick */
  int32_t conditioning; /* length of the conditioning sequence, ticks */
  uint16_t dropped;     /* whether the position is missing */
} anhyst_levitation_input;

typedef struct {
  anhyst_supervisor supervisor;
  int32_t position;      /* last plausible position: input of the controller */
  int32_t rest_position; /* position of the armature before it was lifted */
  int32_t reference;     /* reference of the position control */
  int32_t demand;        /* demanded force in the phases BREAKAWAY and SET_DOWN */
  int32_t tick;          /* number of ticks in the phase BREAKAWAY or FALL */
  uint16_t phase;
  uint16_t flags;          /* flags of this tick: ANHYST_SAMPLE_IMPLAUSIBLE or 0 */
  uint16_t starts_control; /* whether position control starts in this tick, with the last demand */
  uint16_t has_position;   /* whether a plausible position was measured */
  uint16_t is_return_ignored; /* whether a returning position is ignored until the command CLEAR */
  uint16_t starts_fall;       /* whether the phase FALL starts in this tick */
} anhyst_levitation;

/* Returns ANHYST_OK if both structures are within their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings);

/* Starts in the state INIT. */
void anhyst_levitation_start(anhyst_levitation *levitation);

/* Executes a command between two ticks. If this is not possible, returns the reason,
   ANHYST_REFUSED_..., and changes nothing. at_zero is true if the last tick drove no current. */
uint16_t anhyst_levitation_command(anhyst_levitation *levitation, uint16_t command,
                                   uint16_t at_zero);

/* Enters the state FAULT for an external reason, between two ticks. `lands` states whether the
   armature lands under position control. Otherwise the armature falls, even if samples arrive,
   because an unreliable sensor or an amplifier that does not follow cannot land it. */
void anhyst_levitation_fail(anhyst_levitation *levitation, uint16_t reason, int lands);

/* Executes one tick: checks the sample and advances the phase. */
void anhyst_levitation_tick(anhyst_levitation *levitation, const anhyst_levitation_limits *limits,
                            const anhyst_levitation_settings *settings,
                            const anhyst_levitation_input *input);

/* Returns whether the position is controlled: in the phases RISE, HOVER and DESCEND. */
static inline int anhyst_levitation_controls(const anhyst_levitation *levitation)
{
  return levitation->phase >= ANHYST_PHASE_RISE && levitation->phase <= ANHYST_PHASE_DESCEND;
}

#ifdef __cplusplus
}
#endif
#endif
