/* SPDX-License-Identifier: Apache-2.0 */
/* The one state machine of every controller: states, commands, faults, conditioning. What the
   currents do in a state is the affair of its body, which is one of force or one of position.

   init -> selftest -> idle -> ready -> run, and fault from everywhere. The first tick leaves init.
   Idle means that the memory of the iron is not known; conditioning, or a command that says how it
   is, leads to ready. Run ends by a command or by the body, which has come to rest. A fault keeps
   its first reason until `clear`, which goes through selftest again. Names in states.h.

   Integers only. Nothing here loops or waits. */
#ifndef ANHYST_SUPERVISOR_H
#define ANHYST_SUPERVISOR_H

#include <stdint.h>

#include "anhyst/control/states.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Why a command cannot be done. */
#define ANHYST_REFUSED_NOT 0U     /* it can */
#define ANHYST_REFUSED_STATE 1U   /* not in this state */
#define ANHYST_REFUSED_CURRENT 2U /* in this state, but current still flows */
#define ANHYST_REFUSED_UNKNOWN 3U /* there is no such command for this body */

typedef struct {
  int32_t step; /* tick of the conditioning sequence */
  uint16_t state;
  uint16_t fault;        /* first reason */
  uint16_t age;          /* ticks since the last plausible sample, 65535 at most */
  uint16_t passed;       /* plausible samples in a row in selftest */
  uint16_t conditioning; /* whether the sequence runs */
  uint16_t known;        /* whether the memory of the iron is taken as known */
} anhyst_supervisor;

/* What a body says of itself when a command comes. */
typedef struct {
  uint16_t levitates; /* whether it is one of position: lift and land; of force: run */
  uint16_t resting;   /* whether it holds nothing up: its currents are zero or go there */
  uint16_t at_zero;   /* whether no current was driven at the tick before */
} anhyst_body;

/* Starts in init. */
void anhyst_supervisor_start(anhyst_supervisor *s);

/* A tick begins: leaves init. */
void anhyst_supervisor_begin(anhyst_supervisor *s);

/* Counts a sample. wrong: the fault that it would be, or ANHYST_FAULT_NONE. A plausible one leads
   on from selftest after `selftest` of them in a row; more than `max_missing_samples` in a row that
   are not are a fault. 1: they are too many. */
int anhyst_supervisor_sample(anhyst_supervisor *s, uint16_t wrong, uint16_t max_missing_samples,
                             uint16_t selftest);

/* Goes to fault, unless it is there. */
void anhyst_supervisor_fail(anhyst_supervisor *s, uint16_t reason);

/* Why a command cannot be done now. */
uint16_t anhyst_supervisor_obstacle(const anhyst_supervisor *s, uint16_t command,
                                    const anhyst_body *body);

/* Does a command to which there is no obstacle. */
void anhyst_supervisor_command(anhyst_supervisor *s, uint16_t command, const anhyst_body *body);

/* Goes on with the conditioning sequence of `length` ticks: 1 while it runs, with its tick in
   s->step; the tick after its last one is ready. */
int anhyst_supervisor_condition(anhyst_supervisor *s, int32_t length);

/* The body has come to rest by itself: run is over. */
void anhyst_supervisor_rest(anhyst_supervisor *s);

#ifdef __cplusplus
}
#endif
#endif
