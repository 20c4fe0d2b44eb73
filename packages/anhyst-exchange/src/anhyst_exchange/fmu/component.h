/* SPDX-License-Identifier: Apache-2.0 */
/* A component that a simulation tool steps, independent of the interface of the tool: values by
 * reference, a clock and states. A linked part defines what the component computes.
 *
 * A part with a rate ticks at this rate, whatever the steps are. A tick at the beginning of a step
 * uses the inputs at this time. Inputs and outputs are held between ticks. A part without a rate
 * ticks once per step. */
#ifndef ANHYST_COMPONENT_H
#define ANHYST_COMPONENT_H

#include <stddef.h>

/* Maximum number of ticks per step. A longer step is rejected, because it would seem to hang. */
#define ANHYST_STEP_TICKS 1e9

typedef enum {
  ANHYST_PHASE_MADE, /* instantiated, or reset */
  ANHYST_PHASE_INITIALISING,
  ANHYST_PHASE_RUNNING,
  ANHYST_PHASE_TERMINATED
} anhyst_phase;

typedef struct anhyst_component anhyst_component;

/* Returns the token that identifies this component. */
const char *anhyst_component_token(void);

/* Functions that return a text return null if they succeed. Otherwise, the text is the reason of
 * the fault, and nothing has changed. */

/* Returns an instance at time 0 with demagnetised iron; null if there is no memory or parameters
 * are damaged. */
anhyst_component *anhyst_component_new(void);
void anhyst_component_free(anhyst_component *component);
const char *anhyst_component_reset(anhyst_component *component);

/* These functions change the phase; the last one returns whether a phase is active. */
const char *anhyst_component_begin(anhyst_component *component, double start);
const char *anhyst_component_run(anhyst_component *component);
const char *anhyst_component_end(anhyst_component *component);
int anhyst_component_is_in_phase(const anhyst_component *component, anhyst_phase phase);

/* Values by reference: 0 is the time, then inputs, outputs, constants. Only inputs can be set. */
const char *anhyst_component_get(const anhyst_component *component, const unsigned *at, size_t n,
                                 double *values);
const char *anhyst_component_set(anhyst_component *component, const unsigned *at, size_t n,
                                 const double *values);

/* Advances by a step from a time, both in s. A step of 0 does nothing. */
const char *anhyst_component_step(anhyst_component *component, double now, double step);

/* Copies everything that changes during a simulation into a state. The first call, with *state
 * null, allocates the state. */
const char *anhyst_component_save(const anhyst_component *component, void **state);
const char *anhyst_component_restore(anhyst_component *component, const void *state);
void anhyst_component_forget(void **state);

/* Convert the state to bytes, which another process can read, and back. */
size_t anhyst_component_bytes(void);
const char *anhyst_component_write(const void *state, unsigned char *bytes, size_t n);
const char *anhyst_component_read(const unsigned char *bytes, size_t n, void **state);

#endif
