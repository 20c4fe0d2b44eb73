/* SPDX-License-Identifier: Apache-2.0 */
/* What a levitating actuator does when: states, lift-off, landing, and what follows when the
   position is lost. Integers only, the same in every number format of the controller around it.

   init -> selftest -> idle -> ready -> run, and fault from everywhere. The first tick leaves init.
   Idle means that the memory of the iron is not known; conditioning, or the command that says that
   the iron is demagnetised, leads to ready. Run lifts, hovers, lands, and goes back to ready:

     breakaway  the demanded force rises until the armature has left its rest by `detect`
     rise       controlled; the reference goes to the target at a limited speed
     hover      controlled; the reference is the target, so that steps are steps
     descend    controlled; the reference goes to the rest at a limited speed
     set down   the demanded force falls to `press`, so that currents going to zero let nothing go
     hold       the position is lost in mid-air: the current stays for `hold` ticks, then falls

   Rest is the position at which the armature was when `lift` came. A fault in the air lands as long
   as the position is known; where it is lost and comes back within the hold, it lands from there. A
   fault keeps its first reason until `clear`, which goes through selftest again.

   Positions rise as the armature rises, q31 of a full scale of the caller's; demands are q31 of the
   full scale of the force. Nothing here loops. */
#ifndef ANHYST_LEVITATION_H
#define ANHYST_LEVITATION_H

#include "anhyst/fixed.h"
#include "anhyst/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* States. */
#define ANHYST_LEVITATION_INIT 0U
#define ANHYST_LEVITATION_SELFTEST 1U
#define ANHYST_LEVITATION_IDLE 2U
#define ANHYST_LEVITATION_READY 3U
#define ANHYST_LEVITATION_RUN 4U
#define ANHYST_LEVITATION_FAULT 5U

/* Phases: what the currents do. */
#define ANHYST_PHASE_REST 0U /* go to zero along a ramp, and stay there */
#define ANHYST_PHASE_BREAKAWAY 1U
#define ANHYST_PHASE_RISE 2U
#define ANHYST_PHASE_HOVER 3U
#define ANHYST_PHASE_DESCEND 4U
#define ANHYST_PHASE_SET_DOWN 5U
#define ANHYST_PHASE_HOLD 6U
#define ANHYST_PHASE_CONDITION 7U /* follow the conditioning sequence of the drives */

/* Commands. */
#define ANHYST_COMMAND_NONE 0U
#define ANHYST_COMMAND_CONDITION 1U    /* at rest in idle or ready, without current */
#define ANHYST_COMMAND_DEMAGNETISED 2U /* likewise */
#define ANHYST_COMMAND_LIFT 3U         /* in ready, with a plausible sample */
#define ANHYST_COMMAND_LAND 4U         /* in run */
#define ANHYST_COMMAND_STOP 5U         /* in run: a fault, which lands; ends conditioning */
#define ANHYST_COMMAND_CLEAR 6U        /* in fault at rest, without current */

/* Reasons of a fault. */
#define ANHYST_FAULT_NONE 0U
#define ANHYST_FAULT_POSITION_MISSING 1U /* no sample */
#define ANHYST_FAULT_POSITION_RANGE 2U   /* beyond low..high */
#define ANHYST_FAULT_POSITION_STEP 3U    /* too far from the one before */
#define ANHYST_FAULT_NO_LIFT 4U          /* the largest force did not lift the armature */
#define ANHYST_FAULT_STOPPED 5U          /* told to */

/* Flags of a tick, beside those of flags.h. */
#define ANHYST_SAMPLE_DOUBTFUL 8U  /* no plausible position: the last one was taken */
#define ANHYST_COMMAND_REFUSED 16U /* the command cannot be done in this state */

/* What a position can be. Constants of a board, outside anything that can be exchanged. */
typedef struct {
  int32_t low; /* below high */
  int32_t high;
  int32_t step; /* largest change from one tick to the next, > 0 */
  uint16_t
      patience;  /* samples in a row that may be missing or implausible; the last one stands in */
  uint16_t hold; /* ticks for which the current stays when the position is lost */
  uint16_t selftest; /* plausible samples in a row until the self-test has passed, > 0 */
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
  uint16_t at_zero;     /* whether no current was driven at the tick before */
  uint16_t command;
} anhyst_levitation_input;

typedef struct {
  int32_t position;  /* the last plausible one: what the controller works with */
  int32_t rest;      /* where the armature lay before it was lifted */
  int32_t reference; /* while controlled: where to */
  int32_t demand;    /* in breakaway and set down: the force to drive */
  int32_t tick;      /* of the conditioning sequence, or of the hold */
  uint16_t state;
  uint16_t phase;
  uint16_t fault;       /* first reason */
  uint16_t flags;       /* ANHYST_SAMPLE_DOUBTFUL, ANHYST_COMMAND_REFUSED */
  uint16_t begins;      /* whether control begins at this tick, with the demand before it */
  uint16_t demagnetise; /* whether the memory of the iron is to be cleared at this tick */
  uint16_t age;         /* ticks since the last plausible position, 65535 at most */
  uint16_t passed;      /* plausible samples in a row in selftest */
  uint16_t known;       /* whether there was a plausible position at all */
} anhyst_levitation;

/* Whether both are within their ranges: ANHYST_OK or ANHYST_BAD_PARAMETER. */
anhyst_status anhyst_levitation_check(const anhyst_levitation_limits *limits,
                                      const anhyst_levitation_settings *settings);

/* Starts in init. */
void anhyst_levitation_start(anhyst_levitation *levitation);

/* One tick: judges the sample, does the command, and moves on. */
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
