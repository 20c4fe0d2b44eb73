/* SPDX-License-Identifier: Apache-2.0 */
/* The state machine of every controller: states, commands, faults, conditioning. The body of the
   controller (force or position) determines the currents in each state.

   The order is init -> selftest -> idle -> ready -> run, and fault from every state. The first tick
   leaves init. Idle means that the hysteresis state is unknown; conditioning, or a command that
   states it, leads to ready. Run ends by a command, or when the body has come to rest. A fault
   keeps its first reason until `clear`, which leads to selftest. states.h contains the names.

   Integers only. No loops, no waiting. */
#ifndef ANHYST_SUPERVISOR_H
#define ANHYST_SUPERVISOR_H

#include <stdint.h>

#include "anhyst/control/states.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Reasons for refusing a command. */
#define ANHYST_REFUSED_NOT 0U     /* not refused */
#define ANHYST_REFUSED_STATE 1U   /* not possible in this state */
#define ANHYST_REFUSED_CURRENT 2U /* possible in this state, but current still flows */
#define ANHYST_REFUSED_UNKNOWN 3U /* unknown command for this body */

typedef struct {
  int32_t step; /* tick of the conditioning sequence */
  uint16_t state;
  uint16_t fault;        /* first reason */
  uint16_t age;          /* ticks since the last plausible sample, at most 65535 */
  uint16_t passed;       /* consecutive plausible samples in selftest */
  uint16_t conditioning; /* whether the conditioning sequence runs */
  uint16_t known;        /* whether the hysteresis state is assumed to be known */
} anhyst_supervisor;

/* State of the body at a command. */
typedef struct {
  uint16_t levitates; /* 1: position controller with lift and land; 0: force controller with run */
  uint16_t resting;   /* whether it holds nothing up: its currents are zero or ramp to zero */
  uint16_t at_zero;   /* whether no current was driven at the last tick */
} anhyst_body;

/* Starts in the state init. */
void anhyst_supervisor_start(anhyst_supervisor *s);

/* Starts a tick: leaves init. */
void anhyst_supervisor_begin(anhyst_supervisor *s);

/* Counts a sample. wrong: the fault of the sample, or ANHYST_FAULT_NONE. In selftest, `selftest`
   consecutive plausible samples lead to idle. More than `max_missing_samples` consecutive
   implausible samples are a fault, and the result is 1. */
int anhyst_supervisor_sample(anhyst_supervisor *s, uint16_t wrong, uint16_t max_missing_samples,
                             uint16_t selftest);

/* Enters the state fault, unless it is already there. */
void anhyst_supervisor_fail(anhyst_supervisor *s, uint16_t reason);

/* Returns the reason why a command is not possible now. */
uint16_t anhyst_supervisor_obstacle(const anhyst_supervisor *s, uint16_t command,
                                    const anhyst_body *body);

/* Executes a command that is possible. */
void anhyst_supervisor_command(anhyst_supervisor *s, uint16_t command, const anhyst_body *body);

/* Advances the conditioning sequence of `length` ticks. Returns 1 while it runs, with its tick in
   s->step. The state is ready one tick after its last tick. */
int anhyst_supervisor_condition(anhyst_supervisor *s, int32_t length);

/* The body has come to rest by itself: run ends. */
void anhyst_supervisor_rest(anhyst_supervisor *s);

#ifdef __cplusplus
}
#endif
#endif
