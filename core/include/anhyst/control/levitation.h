/* SPDX-License-Identifier: Apache-2.0 */
/* What the currents of a levitating actuator do when: lift-off, landing, and what follows when the
   position is lost. States, commands and faults are those of supervisor.h; in the state run, and in
   a fault until the armature lies, one of these phases follows the other. Integers only, the same
   in every number format of the controller around it.

     breakaway  the demanded force rises until the armature has left its rest by `detect`
     rise       controlled; the reference goes to the target at a limited speed
     hover      controlled; the reference is the target, so that steps are steps
     descend    controlled; the reference goes to the rest at a limited speed
     set down   the demanded force falls to `press`, so that currents going to zero let nothing go
     fall       the position is lost in mid-air: the currents are let go; a position that comes back
                within `hold` ticks is landed from

   Rest is the position at which the armature was when it was lifted. A fault in the air lands as
   long as the position is known and the amplifiers do as commanded. A position that jumped is
   not believed any more, whatever follows.

   Positions rise as the armature rises, q31 of a full scale of the caller's; demands are q31 of the
   full scale of the force. Nothing here loops. */
#ifndef ANHYST_LEVITATION_H
#define ANHYST_LEVITATION_H

#include "anhyst/numeric/fixed.h"
#include "anhyst/compensator/flags.h"
#include "anhyst/numeric/status.h"
#include "anhyst/control/supervisor.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a position can be. Constants of a board, outside anything that can be exchanged. */
typedef struct {
  int32_t low; /* below high */
  int32_t high;
  int32_t step;                 /* largest change from one tick to the next, > 0 */
  uint16_t max_missing_samples; /* samples in a row that may be missing or implausible; the last one
                                   stands in */
  uint16_t hold;                /* ticks of a fall in which a position may come back */
  uint16_t selftest;            /* plausible samples in a row until the self-test has passed, > 0 */
} anhyst_levitation_limits;

/* How it lifts and lands; all but the last above zero, rates for one tick. */
typedef struct {
  int32_t detect;   /* distance from the rest that counts as having left it */
  int32_t rise;     /* speed of the reference */
  int32_t descend;  /* likewise */
  int32_t lift;     /* rate of the demand in breakaway */
  int32_t set_down; /* and in set down */
  int32_t most;     /* demand at which breakaway gives up */
  int32_t press;    /* demand at which set down ends: 0, or below it, for a pair of magnets */
} anhyst_levitation_settings;

/* What happens at one tick. */
typedef struct {
  int32_t position;
  int32_t target;
  int32_t demand;       /* of the controller at the tick before */
  int32_t conditioning; /* ticks that the conditioning sequence has */
  uint16_t dropped;     /* whether there is no position */
} anhyst_levitation_input;

typedef struct {
  anhyst_supervisor supervisor;
  int32_t position;  /* the last plausible one: what the controller works with */
  int32_t rest;      /* where the armature lay before it was lifted */
  int32_t reference; /* while controlled: where to */
  int32_t demand;    /* in breakaway and set down: the force to drive */
  int32_t tick;      /* of breakaway, or of the fall */
  uint16_t phase;
  uint16_t flags;  /* ANHYST_SAMPLE_IMPLAUSIBLE */
  uint16_t begins; /* whether control begins at this tick, with the demand before it */
  uint16_t seen;   /* whether there was a plausible position at all */
  uint16_t lost;   /* whether it does not land any more even with a position, until `clear` */
  uint16_t let_go; /* whether a fall begins at this tick */
} anhyst_levitation;

/* Whether both are within their ranges: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings);

/* Starts in init. */
void anhyst_levitation_start(anhyst_levitation *levitation);

/* Does a command between two ticks, or says why it cannot: ANHYST_REFUSED_..., and nothing has
   changed then. at_zero: whether no current was driven at the tick before. */
uint16_t anhyst_levitation_command(anhyst_levitation *levitation, uint16_t command,
                                   uint16_t at_zero);

/* Goes to fault for a reason from outside, between two ticks. lands: whether it comes down in a
   controlled way; otherwise it falls, whatever samples come: neither a sensor that is not to be
   believed nor an amplifier that does not follow can land it. */
void anhyst_levitation_fail(anhyst_levitation *levitation, uint16_t reason, int lands);

/* One tick: judges the sample and moves on. */
void anhyst_levitation_tick(anhyst_levitation *levitation, const anhyst_levitation_limits *limits,
                            const anhyst_levitation_settings *settings,
                            const anhyst_levitation_input *input);

/* Whether the controller of the position is at work: rise, hover, descend. */
static inline int anhyst_levitation_controls(const anhyst_levitation *levitation)
{
  return levitation->phase >= ANHYST_PHASE_RISE && levitation->phase <= ANHYST_PHASE_DESCEND;
}

#ifdef __cplusplus
}
#endif
#endif
