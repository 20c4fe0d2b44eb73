/* SPDX-License-Identifier: Apache-2.0 */
/* A component that other tools step, without any of their interfaces: values by reference, a clock,
   states. What it computes is in its part.

   A part with a rate ticks at that rate, whatever the steps are: the tick of a step's beginning
   uses the inputs as they are then, and between ticks inputs and outputs are held. A part without
   one ticks once a step. */
#ifndef ANHYST_COMPONENT_H
#define ANHYST_COMPONENT_H

#include <stddef.h>

/* Ticks in one step, at most: a longer one is refused, it would seem to hang. */
#define ANHYST_STEP_TICKS 1e9

typedef enum {
  ANHYST_PHASE_MADE, /* instantiated, or reset */
  ANHYST_PHASE_INITIALISING,
  ANHYST_PHASE_RUNNING,
  ANHYST_PHASE_TERMINATED
} anhyst_phase;

typedef struct anhyst_component anhyst_component;

/* What tells this component from any other. */
const char *anhyst_component_token(void);

/* All functions that return a text: null, or why it cannot be; then nothing has changed. */

/* An instance at time 0, its iron demagnetised. Null where memory is short or parameters are
   damaged. */
anhyst_component *anhyst_component_new(void);
void anhyst_component_free(anhyst_component *component);
const char *anhyst_component_reset(anhyst_component *component);

/* From one phase to another. */
const char *anhyst_component_begin(anhyst_component *component, double start);
const char *anhyst_component_run(anhyst_component *component);
const char *anhyst_component_end(anhyst_component *component);
int anhyst_component_is(const anhyst_component *component, anhyst_phase phase);

/* Values by reference: 0 the time, then inputs, outputs, constants. Only inputs can be set. */
const char *anhyst_component_get(const anhyst_component *component, const unsigned *at, size_t n,
                                 double *values);
const char *anhyst_component_set(anhyst_component *component, const unsigned *at, size_t n,
                                 const double *values);

/* Goes on by a step from a time, s. A step of 0 does nothing. */
const char *anhyst_component_step(anhyst_component *component, double now, double step);

/* States: a copy of all that changes, made by the first call where *state is null. */
const char *anhyst_component_save(const anhyst_component *component, void **state);
const char *anhyst_component_restore(anhyst_component *component, const void *state);
void anhyst_component_forget(void **state);

/* The same as bytes, which another process may read. */
size_t anhyst_component_bytes(void);
const char *anhyst_component_write(const void *state, unsigned char *bytes, size_t n);
const char *anhyst_component_read(const unsigned char *bytes, size_t n, void **state);

#endif
