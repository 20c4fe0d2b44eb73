/* SPDX-License-Identifier: Apache-2.0 */
/* The state machine of every controller: states, commands, faults, conditioning. The body of the
   controller (of force or of position) determines the currents in each state.

   The usual order of states is INIT, SELFTEST, IDLE, READY, RUN. Every state can change to FAULT.
   The first tick leaves INIT. In IDLE, the hysteresis state is unknown. The conditioning sequence,
   or a command that states the hysteresis state, leads to READY. RUN ends by a command, or when the
   body has come to rest. FAULT keeps its first reason until the command CLEAR, which leads to
   SELFTEST. states.h contains the names.

   All numbers are integers. No function waits or contains a loop. */
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
  int32_t step; /* tick number of the conditioning sequence */
  uint16_t state;
  uint16_t fault;             /* reason for the state FAULT, latched */
  uint16_t sample_age;        /* number of ticks since the last plausible sample, at most 65535 */
  uint16_t plausible_samples; /* number of consecutive plausible samples in the state SELFTEST */
  uint16_t conditioning;      /* whether the conditioning sequence runs */
  uint16_t known;             /* whether the hysteresis state is assumed to be known */
} anhyst_supervisor;

/* Body of the controller when a command arrives. */
typedef struct {
  uint16_t levitates; /* 1: position controller with LIFT and LAND; 0: force controller with RUN */
  uint16_t resting;   /* whether nothing is levitated: the currents are zero or ramp to zero */
  uint16_t at_zero;   /* whether no current was driven in the last tick */
} anhyst_body;

/* Starts in the state INIT. */
void anhyst_supervisor_start(anhyst_supervisor *s);

/* Starts a tick: leaves the state INIT. */
void anhyst_supervisor_begin(anhyst_supervisor *s);

/* Counts a sample with its fault or ANHYST_FAULT_NONE. In the state SELFTEST, `selftest`
   consecutive plausible samples lead to IDLE. More than `max_missing_samples` consecutive
   implausible samples cause a fault, and the function returns 1. */
int anhyst_supervisor_sample(anhyst_supervisor *s, uint16_t fault, uint16_t max_missing_samples,
                             uint16_t selftest);

/* Enters the state FAULT, unless it is already active. */
void anhyst_supervisor_fail(anhyst_supervisor *s, uint16_t reason);

/* Returns the reason why a command is not possible now, or ANHYST_REFUSED_NOT. */
uint16_t anhyst_supervisor_obstacle(const anhyst_supervisor *s, uint16_t command,
                                    const anhyst_body *body);

/* Executes a command for which anhyst_supervisor_obstacle returns ANHYST_REFUSED_NOT. */
void anhyst_supervisor_command(anhyst_supervisor *s, uint16_t command, const anhyst_body *body);

/* Advances the conditioning sequence of `length` ticks. Returns 1 while the sequence runs, with the
   tick number in s->step. One tick after the end of the sequence, the state is READY. */
int anhyst_supervisor_condition(anhyst_supervisor *s, int32_t length);

/* Reports that the body has come to rest by itself: ends the state RUN. */
void anhyst_supervisor_rest(anhyst_supervisor *s);

#ifdef __cplusplus
}
#endif
#endif
