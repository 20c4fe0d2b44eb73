/* SPDX-License-Identifier: Apache-2.0 */
/* The sequence of a levitating actuator: lift-off, landing, and the reaction to a lost position.
   supervisor.h defines states, commands and faults. In the state run, and in a fault until the
   armature is at rest, these phases follow one another. Integers only, the same for every number
   format of the controller.

     breakaway  the demanded force rises until the armature has moved by `detect` from its rest
     rise       controlled; the reference moves to the target at a limited speed
     hover      controlled; the reference is the target, so that steps of it are applied as steps
     descend    controlled; the reference moves to the rest position at a limited speed
     set down   the demanded force falls to `press`, so that the armature does not drop when the
                currents go to zero
     fall       the position is lost in mid-air: the currents are reduced; if the position returns
                within `hold` ticks, the armature lands under control

   Rest is the position of the armature before it was lifted. After a fault in the air, the armature
   lands under control if the position is known and the amplifiers follow. A position that jumped is
   not accepted again until `clear`.

   Positions rise when the armature rises, q31 of a full scale of the caller. Demands are q31 of the
   full scale of the force. No loops. */
#ifndef ANHYST_LEVITATION_H
#define ANHYST_LEVITATION_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/status.h"
#include "anhyst/control/supervisor.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Plausibility limits of the position: constants of a board, which no exchange can change. */
typedef struct {
  int32_t low; /* less than high */
  int32_t high;
  int32_t step;                 /* maximum change per tick, > 0 */
  uint16_t max_missing_samples; /* maximum number of consecutive samples that may be missing or
                                   implausible; the last plausible sample replaces them */
  uint16_t hold;                /* ticks of a fall in which a position may return */
  uint16_t selftest;            /* consecutive plausible samples that the self-test requires, > 0 */
} anhyst_levitation_limits;

/* Settings of lift-off and landing; all except the last above zero, rates per tick. */
typedef struct {
  int32_t detect;   /* distance from rest that counts as lift-off */
  int32_t rise;     /* speed of the reference in rise */
  int32_t descend;  /* speed of the reference in descend */
  int32_t lift;     /* rate of the demand in breakaway */
  int32_t set_down; /* rate of the demand in set down */
  int32_t most;     /* demand at which breakaway fails */
  int32_t press;    /* demand at which set down ends: 0, or negative for a pair of magnets */
} anhyst_levitation_settings;

/* Inputs of one tick. */
typedef struct {
  int32_t position;
  int32_t target;
  int32_t demand;       /* of the controller at the last tick */
  int32_t conditioning; /* length of the conditioning sequence, ticks */
  uint16_t dropped;     /* whether the position is missing */
} anhyst_levitation_input;

typedef struct {
  anhyst_supervisor supervisor;
  int32_t position;  /* last plausible position: input of the controller */
  int32_t rest;      /* position of the armature before it was lifted */
  int32_t reference; /* while controlled: reference of the position */
  int32_t demand;    /* in breakaway and set down: the force to drive */
  int32_t tick;      /* of breakaway or fall */
  uint16_t phase;
  uint16_t flags;  /* ANHYST_SAMPLE_IMPLAUSIBLE */
  uint16_t begins; /* whether control starts at this tick, with the demand before it */
  uint16_t seen;   /* whether there was any plausible position */
  uint16_t lost;   /* whether a returning position is ignored until `clear` */
  uint16_t let_go; /* whether a fall starts at this tick */
} anhyst_levitation;

/* Returns ANHYST_OK if both structures are within their ranges, otherwise ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings);

/* Starts in the state init. */
void anhyst_levitation_start(anhyst_levitation *levitation);

/* Executes a command between two ticks. If it cannot, returns the reason, ANHYST_REFUSED_..., and
   changes nothing. at_zero: whether no current was driven at the last tick. */
uint16_t anhyst_levitation_command(anhyst_levitation *levitation, uint16_t command,
                                   uint16_t at_zero);

/* Enters the state fault for an external reason, between two ticks. lands: whether the armature
   lands under control. Otherwise it falls, whatever samples arrive, because an unreliable sensor or
   an amplifier that does not follow cannot land it. */
void anhyst_levitation_fail(anhyst_levitation *levitation, uint16_t reason, int lands);

/* Executes one tick: checks the sample and advances the phase. */
void anhyst_levitation_tick(anhyst_levitation *levitation, const anhyst_levitation_limits *limits,
                            const anhyst_levitation_settings *settings,
                            const anhyst_levitation_input *input);

/* Returns whether the position controller is active: rise, hover, descend. */
static inline int anhyst_levitation_controls(const anhyst_levitation *levitation)
{
  return levitation->phase >= ANHYST_PHASE_RISE && levitation->phase <= ANHYST_PHASE_DESCEND;
}

#ifdef __cplusplus
}
#endif
#endif
